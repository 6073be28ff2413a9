"""What both commands stand on: errors, console, progress, writing without leaving halves."""
