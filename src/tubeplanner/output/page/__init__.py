"""3D scenes as one offline HTML page; scripts and styles in assets/ (today views/page/)."""
