"""The board link: frames, messages, the stream of samples, commands and their answers."""
