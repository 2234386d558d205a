"""One module a command, loaded on call; start, main, console and errors load no NumPy."""
