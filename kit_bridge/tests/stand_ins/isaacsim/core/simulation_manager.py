"""F15: the simulation's clock."""

from omni import physx


class SimulationManager:
    @staticmethod
    def get_simulation_time():
        return physx.time_s
