"""From records to responses, delays and noise levels."""

from robustid.data.estimate.frf_bounds import joint_radius, variances

__all__ = ["joint_radius", "variances"]
