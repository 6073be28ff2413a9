"""Steps of a city: tasks of one kind after those of another, and their total cost."""

from collections.abc import Callable
from typing import Any

from ..base.errors import MOST_NAMED, UnfinishedError
from ..base.progress import Stages
from .store import Store
from .tasks import Done, Task


class TaskSteps:
    """Runs the tasks of one step after another. took: the outcome of every task so far, by its name."""

    def __init__(
        self,
        store: Store,
        engine: Any,  # of `tasks.tiling_engine`
        stages: Stages,
    ) -> None:
        self.store, self.engine, self.stages = store, engine, stages
        self.took: dict[str, Done] = {}

    def run(
        self, label: str, tasks: list[Task], arrived: Callable[[Done], None] = lambda done: None
    ) -> dict[str, Done]:
        """The outcome of all tasks, by name."""
        found = {}
        with self.stages.stage(label, total=len(tasks)) as advance:
            for done in self.engine.run(tasks):
                found[done.name] = done
                arrived(done)
                advance()
        self.took |= found
        return found

    def need(self, label: str, tasks: list[Task]) -> list[Any]:
        """Results of tasks that must all succeed. Raises UnfinishedError."""
        found = self.run(label, tasks)
        lost = [done for done in found.values() if done.error]
        if lost:
            more = f" and {len(lost) - 1} more" if len(lost) > 1 else ""
            raise UnfinishedError(f"{lost[0].name}{more} failed: {lost[0].error}; run again with `resume`")
        return [found[task.name].result for task in tasks]


def name_failed(lost: list[Done]) -> str:
    """Some failed tasks and their reasons, in one line; tasks that only waited for others are left out."""
    failed = [done for done in lost if not done.error.startswith("waits")]
    return "; ".join(f"{done.name}: {done.error}" for done in failed[:MOST_NAMED])
