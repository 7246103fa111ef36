from typing import Any

class NonnegativeConeT:
    def __init__(self, size: int) -> None: ...

class SecondOrderConeT:
    def __init__(self, size: int) -> None: ...

class PSDTriangleConeT:
    def __init__(self, size: int) -> None: ...

class DefaultSettings:
    verbose: bool
    tol_gap_abs: float
    tol_gap_rel: float
    tol_feas: float
    chordal_decomposition_enable: bool

class DefaultSolver:
    def __init__(self, P: Any, q: Any, A: Any, b: Any, cones: Any, settings: DefaultSettings) -> None: ...
    def solve(self) -> Any: ...
