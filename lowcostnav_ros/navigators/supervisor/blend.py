"""Changing from one solution to another without a jump: the difference at the change is carried along and dies away."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from lowcostnav_ros.base.measurements import NavSolution
from lowcostnav_ros.physics.earth import difference_n, displace
from lowcostnav_ros.physics.rotation import quat_apply_phi_n, quat_conjugate, quat_multiply, rotvec_from_quat


@dataclass(slots=True)
class Blend:
    """Offsets published minus source: position (3,) m NED, velocity (3,) m/s, attitude (3,) rad in n, decaying with ``tau_s``."""

    tau_s: float
    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    attitude: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def decay(self, dt_s: float) -> None:
        """Let the offsets die away for ``dt_s``."""
        factor = math.exp(-dt_s / self.tau_s)
        self.position, self.velocity, self.attitude = self.position * factor, self.velocity * factor, self.attitude * factor

    def bridge(self, old: NavSolution, new: NavSolution) -> None:
        """Add to the offsets what lies between the source published so far and the one from now on, both at one stamp."""
        self.position = self.position + difference_n(*old.place, *new.place)
        if old.vel_n is not None and new.vel_n is not None:
            self.velocity = self.velocity + old.vel_n - new.vel_n
        if old.q_nb is not None and new.q_nb is not None:
            published = quat_apply_phi_n(old.q_nb, self.attitude)
            self.attitude = rotvec_from_quat(quat_multiply(published, quat_conjugate(new.q_nb)))

    def applied(self, source: NavSolution) -> NavSolution:
        """Return the source with the offsets added and, as they are known errors, their squares on its covariances."""
        lat, lon, height = displace(*source.place, self.position)
        vel, q = source.vel_n, source.q_nb
        return replace(
            source,
            lat=lat,
            lon=lon,
            height=height,
            vel_n=None if vel is None else vel + self.velocity,
            q_nb=None if q is None else quat_apply_phi_n(q, self.attitude),
            cov_pos=source.place_cov + np.outer(self.position, self.position),
            cov_vel=None if source.cov_vel is None else source.cov_vel + np.outer(self.velocity, self.velocity),
            cov_att=None if source.cov_att is None else source.cov_att + np.outer(self.attitude, self.attitude),
        )
