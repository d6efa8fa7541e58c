"""The simulation thread: steps in real time, takes commands between steps, leaves the newest state for whoever draws.

Drawing never holds it up: a state is taken at most ``STATES`` times a second and put where the next one replaces it.
"""

from __future__ import annotations

import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from quasirigid.arrays.types import FloatArray
from quasirigid.errors import QuasirigidError
from quasirigid.live.play import Figures, Play
from quasirigid.live.real_time_factor import RealTimeFactor
from quasirigid.scene.model import SceneModel, SceneState

STATES = 40.0
"""States taken per second of wall clock, at most."""
BEHIND = 0.05
"""Later than this (s), the simulation gives up catching up and goes on in slow motion."""
IDLE = 0.01
"""How long a paused session sleeps at most before it looks at the world again, s."""
HISTORY = 160
"""Samples kept for the plots: every one costs a page without a graphics card its share at every redrawing."""
SAMPLES = 10.0
"""Samples per second."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What the drawing gets."""

    model: SceneModel
    state: SceneState
    figures: Figures
    running: bool
    real_time: float
    """Simulated over wall-clock time."""
    speed: float
    """What was asked for."""
    step_time: float
    """Mean computing time of the steps since the last frame, s."""
    pulled: tuple[FloatArray, FloatArray, float] | None
    base: tuple[FloatArray, FloatArray]
    """Where the base is sent: position, quaternion."""
    finger_aims: FloatArray
    generation: int
    """Another number after every rebuild."""
    choice: str
    """What the object is, in the panel's list."""


@dataclass(frozen=True)
class Sample:
    """One point of the plots."""

    time: float
    forces: tuple[float, ...]
    step_time: float
    contacts: int


class Session:
    """Runs a ``Play`` in a thread of its own. All public methods may be called from any thread."""

    def __init__(self, play: Play, *, running: bool = False) -> None:
        self._play = play
        self._commands: queue.SimpleQueue[Callable[[Play], None]] = queue.SimpleQueue()
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._fresh = threading.Condition()
        self._frame: Frame | None = None
        self._count = 0
        self._running = running
        self._speed = 1.0
        self._single = 0
        self._clock = (0.0, 0.0)
        self._generation = 0
        self._real_time_factor = RealTimeFactor()
        self._step_times: list[float] = []
        self._next_sample = 0.0
        self.samples: deque[Sample] = deque(maxlen=HISTORY)
        """For the plots; append-only but for the oldest."""
        self.complaints: queue.SimpleQueue[str] = queue.SimpleQueue()
        """What went wrong in a command, to be shown in the page."""
        self._observers: list[Callable[[Play], None]] = []
        self._thread = threading.Thread(target=self._run, name="quasirigid-simulation", daemon=True)
        self._publish()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)
        with self._fresh:
            self._fresh.notify_all()

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return not self._stop.is_set()

    def do(self, command: Callable[[Play], None]) -> None:
        """Have the simulation thread do something to its world between two steps."""
        self._commands.put(command)
        self._wake.set()

    def observe(self, observer: Callable[[Play], None]) -> None:
        """Call this in the simulation thread after every step: recorders. One that raises is a complaint, and not called again."""
        self.do(lambda _: self._observers.append(observer))

    def run(self, on: bool) -> None:
        """Run or pause."""

        def set_running(_: Play) -> None:
            self._running = on
            self._restart_clock()

        self.do(set_running)

    def single(self, steps: int = 1) -> None:
        """Pause, and take so many steps."""

        def step(_: Play) -> None:
            self._running, self._single = False, self._single + steps

        self.do(step)

    def set_speed(self, speed: float) -> None:
        """Simulated seconds per second."""

        def set_speed(_: Play) -> None:
            self._speed = speed
            self._restart_clock()

        self.do(set_speed)

    def reset(self) -> None:
        """Everything as at the start, paused."""

        def rebuild(play: Play) -> None:
            play.build()
            self._begin_anew()

        self.do(rebuild)

    def load(self, make: Callable[[], Play]) -> None:
        """Another grasp. It is built by the caller's thread of choice: ``make`` runs in the simulation thread, errors are complaints."""

        def replace(_: Play) -> None:
            self._play = make()
            self._begin_anew()

        self.do(replace)

    def newest(self, after: int = -1, timeout: float = 1.0) -> tuple[int, Frame]:
        """The newest frame and its number; waits until there is one after ``after``, at most ``timeout`` s."""
        with self._fresh:
            self._fresh.wait_for(lambda: self._count > after or self._stop.is_set(), timeout)
            assert self._frame is not None
            return self._count, self._frame

    # The thread.

    def _begin_anew(self) -> None:
        self._running, self._single = False, 0
        self._generation += 1
        self.samples.clear()
        self._next_sample = 0.0
        self._restart_clock()

    def _restart_clock(self) -> None:
        self._clock = (time.perf_counter(), self._play.world.time)
        self._real_time_factor.clear()

    def _run(self) -> None:
        self._restart_clock()
        published = 0.0
        while not self._stop.is_set():
            changed = self._obey()
            stepped = self._advance(published)
            now = time.perf_counter()
            if ((changed or stepped) and now - published >= 1.0 / STATES) or (changed and not self._running):
                published = now
                try:
                    self._publish()
                except Exception as error:
                    self._running, self._single = False, 0
                    self._complain(error)
            if not stepped:
                self._wake.wait(IDLE if self._running else 0.2)
                self._wake.clear()

    def _obey(self) -> bool:
        done = False
        while True:
            try:
                command = self._commands.get_nowait()
            except queue.Empty:
                return done
            done = True
            self._carry_out(command)

    def _carry_out(self, command: Callable[[Play], None]) -> bool:
        """Whether it went well; if not, that is a complaint."""
        try:
            command(self._play)
        except Exception as error:
            self._complain(error)
            return False
        return True

    def _complain(self, error: Exception) -> None:
        """Says in the page what went wrong. A bug must not end the session: its traceback goes to the console."""
        if isinstance(error, QuasirigidError):
            self.complaints.put(str(error))
        else:
            traceback.print_exception(error)
            self.complaints.put(f"{type(error).__name__}: {error}")

    def _advance(self, published: float) -> bool:
        """Steps until the clock is reached, a state is due, or commands wait."""
        if self._single > 0:
            self._single -= 1
            self._step()
            return True
        if not self._running:
            return False
        wall, simulated = self._clock
        stepped = False
        while self._commands.empty():
            now = time.perf_counter()
            due = simulated + self._speed * (now - wall)
            late = due - self._play.world.time
            if late < self._play.world.dt:
                if not stepped:
                    time.sleep(min(IDLE, max(0.0, (self._play.world.dt - late) / self._speed)))
                break
            if late > self._speed * BEHIND:
                self._clock = (now - BEHIND, self._play.world.time)  # slow motion: what is lost is lost
                wall, simulated = self._clock
            self._step()
            stepped = True
            if time.perf_counter() - published >= 1.0 / STATES:
                break
        return stepped

    def _step(self) -> None:
        try:
            report = self._play.step()
        except Exception as error:  # it would come again in every step: paused, until somebody does something about it
            self._single = 0
            self.run(False)
            self._complain(error)
            return
        self._step_times.append(report.step_time)
        for observer in tuple(self._observers):
            if not self._carry_out(observer):
                self._observers.remove(observer)  # a full disk must not end the session
        self._real_time_factor.update(self._play.world.time)

    def _publish(self) -> None:
        play = self._play
        state = play.state()
        mean = sum(self._step_times) / len(self._step_times) if self._step_times else state.step_time
        self._step_times.clear()
        if state.time >= self._next_sample:
            self._next_sample = state.time + 1.0 / SAMPLES
            self.samples.append(Sample(state.time, tuple(state.normal_forces.tolist()), mean, len(state.contacts)))
        frame = Frame(
            model=play.scene.model,
            state=state,
            figures=play.figures,
            running=self._running or self._single > 0,
            real_time=self._real_time_factor.value(self._speed),
            speed=self._speed,
            step_time=mean,
            pulled=play.pulled,
            base=play.base_aim,
            finger_aims=play.finger_aims(),
            generation=self._generation,
            choice=play.choice,
        )
        with self._fresh:
            self._frame = frame
            self._count += 1
            self._fresh.notify_all()
