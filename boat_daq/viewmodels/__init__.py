"""What each page knows and decides, without Qt."""
