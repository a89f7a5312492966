"""The board link: frames, messages, the sample stream, commands and their answers."""
