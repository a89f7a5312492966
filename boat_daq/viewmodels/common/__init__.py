"""What every view model uses: formatting, undo, notices, preferences, background work."""
