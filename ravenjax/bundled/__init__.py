"""Files that come with the package: campaigns and models; where a wheel holds them."""
