"""The program inside a bundle: `boat-daq` as installed, and its helper processes.

A helper process is started by `sys.executable`, which in a bundle is the program itself: what `multiprocessing` spawns
is recognised by its own marks, and a module of ours by the options of `boat_daq.own_packages.start_module`.
"""

import multiprocessing
import runpy
import sys

multiprocessing.freeze_support()
if sys.argv[1:3] == ["-P", "-m"]:
    sys.argv = sys.argv[3:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
else:
    from boat_daq.__main__ import main

    main()
