"""A thread of a test."""

import threading


class Worker:
    """Calls run() on a thread until `stopping` is set; what it raises is raised by stop()."""

    def __init__(self):
        self.failed = None
        self.stopping = threading.Event()
        self.thread = threading.Thread(target=self._guarded, daemon=True)
        self.thread.start()

    def _guarded(self):
        try:
            self.run()
        except Exception as error:
            self.failed = error

    def run(self):
        raise NotImplementedError

    def stop(self):
        self.stopping.set()
        self.thread.join(60)
        if self.failed:
            raise self.failed
