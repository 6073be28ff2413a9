"""A process that runs commands in copies of itself, with a fault at one of their file operations: see `fault_runs`."""

import ctypes
import json
import os
import sys
import time
import traceback

MOST_SECONDS = 120.0
"""Of one run; what takes longer hangs."""


def main():
    """Answer lines of JSON, each what to run, by lines of JSON, each what came of it."""
    import relight.cli
    import splat2mesh.cli

    _lighten()
    commands = {"splat2mesh": splat2mesh.cli.main, "relight": relight.cli.main}
    shim, answers = ctypes.CDLL(os.environ["FAULTS"]), os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(1, 2)
    for line in sys.stdin:
        wish = json.loads(line)
        for run in wish["warm"]:
            os.chdir(run["folder"])
            commands[run["command"]](run["arguments"])
        started = [_started(commands, shim, run) for run in wish["runs"]]
        answers.write(json.dumps([_ended(*each) for each in started]) + "\n")
        answers.flush()


def _lighten():
    """Leave out what only takes time: the mesh of a splat is known, pictures are small. All files are still there."""
    from fault_cases import scene_of

    import relight.jobs.meshing
    import relight.jobs.results
    import relight.jobs.writer
    import splat2mesh.api

    relight.jobs.meshing.meshed = splat2mesh.api.convert = lambda path, *_, **__: scene_of(path)
    relight.jobs.results.PICTURE_SIZE = relight.jobs.writer.PICTURE_SIZE = (64, 48)


def _started(commands, shim, run):
    """(process, file of what it says, time) of a run that has begun."""
    said = run["said"]
    process = os.fork()
    if process:
        return process, said, time.monotonic()
    code = 99
    try:
        output = os.open(said, os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o600)
        os.dup2(output, 1)
        os.dup2(output, 2)
        names = os.open(run["names"], os.O_CREAT | os.O_TRUNC | os.O_WRONLY, 0o600) if run.get("names") else -1
        os.chdir(run["folder"])
        time.sleep(run.get("wait", 0.0))
        shim.faults_arm(os.fsencode(run["folder"]), ctypes.c_long(run["at"]), run["kind"], run["detail"], names)
        code = commands[run["command"]](run["arguments"])
    except SystemExit as error:
        code = error.code or 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _ended(process, said, begun):
    """[exit code, or minus the signal, or None where it hung; what it said]."""
    while True:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            break
        if time.monotonic() - begun > MOST_SECONDS:
            os.kill(process, 9)
            os.waitpid(process, 0)
            return None, ""
        time.sleep(0.002)
    with open(said, encoding="utf-8", errors="replace") as file:
        return os.waitstatus_to_exitcode(status), file.read()


if __name__ == "__main__":
    main()
