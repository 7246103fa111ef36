"""From records to responses, delays and noise levels."""

from robustid.data.error_sets import joint_radius, variances

__all__ = ["joint_radius", "variances"]
