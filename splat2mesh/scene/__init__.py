"""The scene: a chunked triangle mesh with colours, in a folder or a file."""
