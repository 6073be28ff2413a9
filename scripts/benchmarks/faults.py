"""A fault at every file operation of both commands: what is lost, half-written, left behind, or ends with a wrong exit
code.

Whole commands run on small scenes; each of their operations on files (opening, writing, renaming, removing, making
folders) fails in turn, in six ways: one error of the device; the device is gone from there on, for clean-up too; the
disk is full from there on; kill -9, in the middle of a write; SIGTERM; Ctrl-C. After each run another one, without a
fault, must succeed and leave the same files as a run without faults. Then pairs of runs write one output at once. The
mesh of the splat is known beforehand and pictures are small: `tests/support/fault_server.py`.
"""

import random
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

from benchmarks.harness import ROOT

QUICK = ["mesh", "--every", "7", "--races", "1"]
CODES = (0, 1, 2, 130, -9)


def arguments(parser):
    """Arguments of this subject."""
    parser.add_argument("cases", nargs="*", metavar="CASE", help="only these of the commands")
    parser.add_argument("--faults", nargs="+", metavar="FAULT", help="only these")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="one in N operations (default: all)")
    parser.add_argument("--races", type=int, default=40, metavar="N", help="runs at once (default: %(default)s pairs)")
    parser.add_argument("--seed", type=int, default=0, metavar="N")


def run(options, report):
    """Put faults into all cases, then let runs race."""
    sys.path.insert(0, str(ROOT / "tests" / "support"))
    import fault_runs
    from fault_cases import CASES, made

    names = options.cases or list(CASES)
    with tempfile.TemporaryDirectory() as folder:
        library = fault_runs.built(folder)
        if library is None:
            sys.exit("scripts/bench faults: it needs Linux and a C compiler")
        server = fault_runs.Server(library, folder)
        columns = {"case": "<8", "fault": "<8", "operations": "d", "runs": "d"}
        columns |= {str(code): "d" for code in CODES} | {"other": "d", "wrong": "d"}
        table = report.table("runs with a fault, by exit code", **columns)
        for name in names:
            place = Path(folder, name)
            trial = fault_runs.Trial(server, CASES[name], made(place / "template", name), place)
            for fault in options.faults or fault_runs.FAULTS:
                first = options.seed % options.every
                found = [trial.outcome(fault, at) for at in range(first, len(trial.operations), options.every)]
                codes = Counter(each.code for each in found)
                known = {str(code): codes.pop(code, 0) for code in CODES}
                wrong = [each for each in found if each.wrong]
                count = {"operations": len(trial.operations), "runs": len(found), "wrong": len(wrong)}
                table.add(case=name, fault=fault, **count, **known, other=sum(codes.values()))
                for each in wrong:
                    said = each.said.strip().splitlines()[-1:]
                    operation = trial.operations[each.at].replace(f"{place}/run/", "")
                    report.note(f"  {name} {fault} at {each.at} ({operation}): {'; '.join(each.wrong)} {said}")
        for name in names:
            _race(server, name, Path(folder, f"race-{name}"), options, report)
        server.close()


def _race(server, name, place, options, report):
    """Pairs of runs at once, with a random lead: one of both does it, the other too or is refused, nothing is left."""
    from fault_cases import CASES, made
    from fault_runs import part_of, state_of

    case, chance = CASES[name], random.Random(options.seed)
    template, folder = made(place / "template", name), place / "run"
    codes, wrong = Counter(), 0
    for number in range(options.races):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(template, folder)
        if number == 0:
            server.run(case, folder)
            after = state_of(folder)
            continue
        lead = chance.uniform(0.0, 0.03)
        ended = server.at_once([(case, folder, 0.0), (case, folder, lead)])
        codes[tuple(sorted(code for code, _ in ended))] += 1
        found, faults = state_of(folder), []
        if not any(code == 0 for code, _ in ended) or any(code not in (0, 2) for code, _ in ended):
            faults.append(f"exit codes {[code for code, _ in ended]}: {[said for _, said in ended]}")
        if any(part_of(found, output) != part_of(after, output) for output in case.outputs):
            faults.append("the output is wrong")
        odd = sorted(path for path in {*found, *after} if found.get(path) != after.get(path))
        faults += [f"{path} differs" for path in odd]
        wrong += bool(faults)
        for fault in faults:
            report.note(f"  {name} raced: {fault}")
    listed = ", ".join(f"{a} and {b}: {count}" for (a, b), count in sorted(codes.items()))
    report.note(f"{name}: {sum(codes.values())} pairs at once, exit codes {listed}; {wrong} wrong")
