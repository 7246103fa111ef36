"""Matrix-fraction fitting of frequency responses, with condition number one.

In the making: stability enforcement, rigid-body modes, instrumental variables, covariances and order selection are to come,
then the front door.
"""

from robustid.mfd.criterion import Weight
from robustid.mfd.fit import MatrixFraction, fit_mfd

__all__ = ["MatrixFraction", "Weight", "fit_mfd"]
