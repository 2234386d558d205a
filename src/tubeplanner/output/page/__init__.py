"""3D scenes as one offline HTML page; scripts and styles are in `assets`."""
