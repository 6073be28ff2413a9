"""A worker of sessions that computes in the process of the test."""

from relight.viewer.lighting import SessionLighting
from relight.viewer.worker import ReportedStages, answers


class InlineWorker:
    """As ProcessWorker, in this process: `poll` works until the wish is answered."""

    def __init__(self, scene):
        steps = ReportedStages(lambda *progress: None, lambda: None)
        self._lighting = SessionLighting(scene, steps)
        self._wish = None

    def submit(self, wish):
        """Request the newest wish; unfinished work of an older one is dropped."""
        self._wish = wish

    def poll(self):
        """Messages since the last call: a list of tuples, as `ProcessWorker.poll` returns them."""
        if self._wish is None:
            return []
        wish, self._wish = self._wish, None
        return list(answers(self._lighting, wish))

    def close(self):
        """Do nothing: there is no process to end."""
