"""A plugin in a process of its own: `python -m boat_daq.plugin_process GROUP NAME`, called with JSON on standard input.

Its keywords are that JSON; the result is JSON on standard output, prints go to standard error. The caller limits time.
"""

import sys


def main() -> None:
    """Load one entry point, call it, and write its result."""
    import json
    from importlib.metadata import entry_points

    result, sys.stdout = sys.stdout, sys.stderr
    group, name = sys.argv[1:3]
    called, arguments = json.loads(sys.stdin.read())
    (found,) = entry_points(group=group, name=name)
    loaded = found.load()
    function = getattr(loaded, called, None) if called else loaded
    returned = None if function is None else function(**arguments)
    result.write(json.dumps(returned, default=str))
    result.flush()


if __name__ == "__main__":
    main()
