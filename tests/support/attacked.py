"""A process that reads the hostile files named on its input, line by line, and prints the outcome of each: see
`attacks`."""

import json
import os
import resource
import sys
import time
import warnings


def main():
    """Answer lines of [kind, path, summed] by lines of [outcome, detail, GB, seconds]."""
    from attacks import READERS, content_of

    from splat2mesh.base.errors import InputError

    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        kind, path, whole = json.loads(line)
        begun = time.process_time()
        try:
            found = READERS[kind](path)
            same = whole is None or content_of(found) == whole
            outcome, detail = ("read", "") if same else ("silent", "")
        except InputError as error:
            broken = "\n" in str(error) or not str(error)
            outcome, detail = ("traceback", "a message of several lines") if broken else ("refused", "")
        except Exception as error:
            outcome, detail = "traceback", f"{type(error).__name__}: {error}"[:200]
        found = None
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        answers.write(json.dumps([outcome, detail, peak, time.process_time() - begun]) + "\n")
        answers.flush()


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    main()
