"""What both command lines share: one-line errors, exit codes, warnings and results on the right streams."""

import json
import os
import sys
import traceback
import warnings

from .errors import DataWarning, InputError

EXIT_DONE, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def run(command, options):
    """Run `command(options)` and return the process's exit code.

    command: callable that takes the parsed options and returns (summary lines, result dict).
    options: needs `.json`, `.quiet`, `.verbose`. The result goes to stdout, everything else to stderr.
    """
    warnings.showwarning = _show_warning
    warnings.simplefilter("ignore")
    warnings.simplefilter("always", DataWarning)
    try:
        lines, result = command(options)
    except InputError as error:
        return _fail(error, EXIT_BAD_INPUT, options)
    except KeyboardInterrupt:
        return _fail("interrupted", EXIT_FAILED, options)
    except Exception as error:
        text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        return _fail(f"{text} (run again with -v for the traceback)", EXIT_FAILED, options)
    try:
        if options.json:
            print(json.dumps(result))
        elif not options.quiet:
            print("\n".join(lines))
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read along has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return EXIT_DONE


def wants_progress(options):
    """Whether progress bars belong on this run's stderr: only a terminal, and only when not told to be quiet."""
    return sys.stderr.isatty() and not options.quiet


def peak_mb():
    """Largest resident size of this process so far, in MiB."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / 2**20 if sys.platform == "darwin" else peak / 2**10, 1)


def _fail(error, code, options):
    if options.verbose:
        traceback.print_exc()
    print("error: " + " ".join(str(error).split()), file=sys.stderr)
    return code


def _show_warning(message, category, filename, lineno, file=None, line=None):
    print(f"warning: {message}", file=sys.stderr)
