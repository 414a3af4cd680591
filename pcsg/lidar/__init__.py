"""Laser scans: beams with a width, several echoes, noise, LAS files.

    cloud = pcsg.lidar.scan(scene, "vz400", legs=[(0, 0, 1.5)], seed=1)
    cloud.write("plot.laz")
    pcsg.lidar.density(cloud, box).area

Metres, degrees, nanoseconds; docs/science.md has examples.
"""

from pcsg.lidar.cloud import Cloud
from pcsg.lidar.echoes import scan
from pcsg.lidar.scanners import SCANNERS, Leg, Scanner
from pcsg.lidar.voxels import Density, density

__all__ = ["SCANNERS", "Cloud", "Density", "Leg", "Scanner", "density", "scan"]
