"""Runs programs in processes that are forked after numba is imported, which takes most of their time.

Each line of standard input is a request in JSON: the program, its folder, its environment, and files for
standard output, standard error and the status at the end. The answer is the number of the process.
"""

import json
import os
import signal
import sys
import traceback

import numba

numba.njit(lambda: 0)()  # loads the rest of the compiler


def run(request):
    """Run a program as ``python -c`` does, from its folder."""
    for descriptor, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(request[name], os.O_WRONLY), descriptor)
    os.environ.clear()
    os.environ.update(request["env"])
    numba.config.reload_config()
    os.chdir(request["folder"])
    sys.path.insert(0, request["folder"])
    sys.dont_write_bytecode = True
    exec(request["program"], {"__name__": "__main__"})  # noqa: S102


def watch(request):
    """Fork the program, announce its number, and write its status when it ends."""
    if program := os.fork():
        print(program, flush=True)
        status = os.waitstatus_to_exitcode(os.waitpid(program, 0)[1])
        with open(request["status"], "w") as file:
            file.write(str(status))
        return
    status = 1
    try:
        run(request)
        status = 0
    except Exception:  # noqa: BLE001
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)  # taking the interpreter down takes ten times as long as the program


signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that watch
for line in sys.stdin:
    if not os.fork():
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        watch(json.loads(line))
        os._exit(0)
