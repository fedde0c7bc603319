"""What MCAP needs: the container and the encodings of its messages."""
