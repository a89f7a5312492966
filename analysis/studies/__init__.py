"""Studies of the methods: time against error, where they fail, and the numbers of the paper computed again."""
