"""The torque of a motor over its speed: anything with `torque(speed)` and `no_load_speed` turns a shaft (`motor`)."""

from dataclasses import dataclass

from compact.refuse import refuse_nonpositive


@dataclass(frozen=True)
class Straight:
    """A motor whose torque falls straight with its speed (direct current): T = stall_torque (1 - w/no_load_speed).

    stall_torque [N m]; no_load_speed [rad/s]
    """

    stall_torque: float
    no_load_speed: float

    def __post_init__(self):
        refuse_nonpositive(stall_torque=self.stall_torque, no_load_speed=self.no_load_speed)

    def torque(self, speed):
        """T [N m] at the motor's speed [rad/s]."""
        return self.stall_torque * (1 - speed / self.no_load_speed)


@dataclass(frozen=True)
class Kloss:
    """An induction motor by Kloss' formula: T = 2 T_b/(s/s_b + s_b/s), s = 1 - w/w_s.

    breakdown_torque : T_b [N m];  breakdown_slip : s_b;  synchronous_speed : w_s [rad/s]

    Stator resistance neglected: M. Kloss, Archiv fuer Elektrotechnik 5 (1916) 59.

    >>> f"{Kloss(50.0, 0.2, 157.0).torque(0.8 * 157.0):.1f} N m"
    '50.0 N m'
    """

    breakdown_torque: float
    breakdown_slip: float
    synchronous_speed: float

    def __post_init__(self):
        refuse_nonpositive(
            breakdown_torque=self.breakdown_torque,
            breakdown_slip=self.breakdown_slip,
            synchronous_speed=self.synchronous_speed,
        )

    @property
    def no_load_speed(self):
        """w_s [rad/s]."""
        return self.synchronous_speed

    def torque(self, speed):
        """T [N m] at the motor's speed [rad/s]; it brakes above w_s."""
        slip = 1 - speed / self.synchronous_speed
        return 2 * self.breakdown_torque * slip * self.breakdown_slip / (slip**2 + self.breakdown_slip**2)
