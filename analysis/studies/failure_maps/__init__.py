"""Where each method breaks down, swept over two of its parameters."""
