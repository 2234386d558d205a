"""The tube: positions and orientations of the tool.."""
