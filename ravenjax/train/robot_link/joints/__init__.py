"""The robot's joint state on the network: record, decoder, and the TCP stream."""
