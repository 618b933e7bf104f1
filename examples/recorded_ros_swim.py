"""Write examples/logs/swim.mcap: a swim as a robot with ROS 2 records it.

    python examples/recorded_ros_swim.py --out examples/logs
    aquafish logs examples/logs/swim.mcap

A fish whose left flipper is broken swims for 8 s, from rest, from hidden fin angles. The topic
/imu/data has its gyroscope at 100 Hz in the axes of ROS: x forward, y left, z up. The topic
/servos/pulse has the pulse widths of its servos, 1100 to 1900 us, at 10 Hz. This needs the extra
logs.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aquafish_gym import Damage, Morphology
from aquafish_gym.rollout import rollout
from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.storage import ensure_writable_directory
from aquafish_gym.utils.validation import MissingExtraError, install_advice

SECONDS = 8.0
HELD = 100  # steps of 0.01 s for which a command is held
PULSE_STEPS = 10  # between two messages of the servos
STARTED = 1_700_000_000_000_000_000  # ns since 1970
DELAY = 1_500_000  # ns from the sensor's stamp to the recorder's
RULE = 80 * "="
HEADER = f"""\
{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
IMU = f"""\
std_msgs/Header header
geometry_msgs/Vector3 angular_velocity
{HEADER}{RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
PULSES = f"""\
std_msgs/Header header
uint16[] data
{HEADER}"""


@dataclass(frozen=True)
class RecordedRosSwim:
    """Write swim.mcap."""

    example: ClassVar[str] = "--damage caudal:length=0.5 --out out/logs"

    out: Out = Path("examples/logs")
    damage: str = "left_pectoral:length=0.5"
    """What broke before the swim."""
    noise: float = 0.01
    """Standard deviation of the gyroscope's noise, rad/s."""
    seed: int = 0
    """Seed of the commands, the fins' starting angles and the noise."""

    def execute(self) -> None:
        """Swim, and write."""
        try:
            from mcap_ros2.writer import Writer
        except ImportError as error:
            raise MissingExtraError(
                f"an MCAP file needs the extra logs ({error}): {install_advice('logs')}"
            ) from None
        body = Damage.parse(self.damage).apply(Morphology.nominal())
        rng = np.random.default_rng(self.seed)
        start = Scenario.create(body, fin_angles=rng.uniform(-np.pi, np.pi, 3))
        (path,) = rollout(
            [lambda *_: np.round(rng.uniform(-1.0, 1.0, 3), 2)],
            start,
            engine="numba",
            seconds=SECONDS,
            interval=HELD,
        ).paths
        gyro = np.vstack([np.zeros(3), path.gyro])
        right, forward, up = (gyro + rng.normal(0.0, self.noise, gyro.shape)).round(4).T.tolist()
        # 800 us for 1 rev/s of a flipper, 400 us for 1 Hz of the tail.
        pulses = np.vstack([path.commands, path.commands[-1]]) * [800.0, 800.0, 400.0] + 1500.0
        folder = ensure_writable_directory(self.out)
        with (folder / "swim.mcap").open("wb") as file:
            log: Any = Writer(file)
            imu = log.register_msgdef("sensor_msgs/msg/Imu", IMU)
            servos = log.register_msgdef("swimmer_msgs/msg/Pulses", PULSES)
            for step in range(len(gyro)):
                stamp = STARTED + round(step * TIMESTEP * 1e9)
                header = _header(stamp)
                if step % PULSE_STEPS == 0:
                    data = pulses[step].round().astype(int).tolist()
                    message: dict[str, Any] = {"header": header, "data": data}
                    log.write_message("/servos/pulse", servos, message, stamp + DELAY)
                turn = {"x": forward[step], "y": -right[step], "z": up[step]}
                message = {"header": header, "angular_velocity": turn}
                log.write_message("/imu/data", imu, message, stamp + DELAY)
            log.finish()
        print(f"written to {folder}: swim.mcap, {SECONDS:g} s of swimming")


def _header(stamp: int) -> dict[str, Any]:
    seconds, nanoseconds = divmod(stamp, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": ""}


if __name__ == "__main__":
    sys.exit(run_command_line("recorded_ros_swim", RecordedRosSwim))
