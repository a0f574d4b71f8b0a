"""What does a robot do when it is dragged, spoilt and mended by hand? A page in the browser."""
