"""Windows, pages and panels: Qt only, no arithmetic."""
