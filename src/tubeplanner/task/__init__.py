"""Problems and cycles, made in Python or read from files."""
