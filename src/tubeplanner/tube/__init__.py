"""Where the tool may be, and its orientation there: pure geometry."""
