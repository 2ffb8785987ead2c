"""Time of an integration alone: compiled, in one thread, and with nothing observed unless it is asked for."""

from dataclasses import dataclass

from impact_env.drive import Drive, constant_frequency
from impact_env.loads import AnyDrive
from impact_env.methods import Method
from impact_env.response import Record, Response
from impact_env.scene import Scene
from impact_env.sweep import simulate

BARE = Record(level=False)


@dataclass(frozen=True)
class Timed:
    """A run that can be timed again and again: compiled and with its tables made by one pseudo period at the resonance, or by a run."""

    scene: Scene
    drive: AnyDrive
    method: Method
    most_events: int | None = None
    record: Record = BARE

    def __post_init__(self) -> None:
        if not isinstance(self.drive, Drive):
            self.run()
            return
        schedule = constant_frequency(self.drive.schedule.reference, 1.0, 1.0)
        simulate(self.scene, Drive(self.drive.amplitude, schedule, self.drive.phase), self.method, record=self.record)

    def run(self) -> Response:
        """Return a response; its ``wall_time`` is the time in s."""
        return simulate(self.scene, self.drive, self.method, record=self.record, most_events=self.most_events)
