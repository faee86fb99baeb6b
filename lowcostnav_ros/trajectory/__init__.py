"""True flights: closed-form manoeuvres, aerobatics, the thesis datasets, a flight-dynamics aircraft, recorded flights."""

from lowcostnav_ros.trajectory.manoeuvres import parse_mission
from lowcostnav_ros.trajectory.missions import MISSIONS, standard
from lowcostnav_ros.trajectory.trajectory import Trajectory
from lowcostnav_ros.trajectory.truth_settings import KINDS, StartSettings, TruthSettings, WindSettings

__all__ = ["KINDS", "MISSIONS", "StartSettings", "Trajectory", "TruthSettings", "WindSettings", "build", "parse_mission", "standard"]


def build(settings: TruthSettings, seed: int = 0) -> Trajectory:
    """Make the true flight that ``settings`` describe.

    Parameters
    ----------
    settings : TruthSettings
    seed : int
        Seed of wind variation and turbulence, not negative.

    Raises
    ------
    SettingsError
        One sentence, for a mission, dataset or recording that cannot be flown.
    """
    if settings.kind == "dataset":
        from lowcostnav_ros.trajectory.datasets import build_dataset

        return build_dataset(settings)
    if settings.kind == "jsbsim":  # loaded only when flown: the flight-dynamics library is large
        from lowcostnav_ros.trajectory.jsbsim_flight import build_jsbsim

        return build_jsbsim(settings, seed)
    if settings.kind == "recorded":
        from lowcostnav_ros.trajectory.recorded import build_recorded

        return build_recorded(settings, seed)
    if settings.kind == "aerobatics":
        from lowcostnav_ros.trajectory.aerobatics import build_aerobatics

        return build_aerobatics(settings, seed)
    from lowcostnav_ros.trajectory.segments import build_segments

    return build_segments(settings, seed)
