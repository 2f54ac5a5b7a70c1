"""What every study is made of: its campaigns, its comparison with published numbers, its files."""
