"""robustid.load() and robustid.save(): whatever the library writes, and what users have measured, through one door."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeGuard, Unpack, overload

from numpy.typing import ArrayLike

from robustid.core import Progress, Signal, as_function, load_saved, paths, saved_kind
from robustid.core import save as save_one
from robustid.errors import FileFormatError, InputError
from robustid.formats import is_network

if TYPE_CHECKING:
    import control

    from robustid.data import FrequencyResponse, TimeRecord


class Reading(TypedDict, total=False):
    """Arguments of `load` about measurements."""

    fields: Mapping[str, object] | None
    dt: float | None
    bound: ArrayLike | None
    frequency_unit: str | None
    inputs: Sequence[str | tuple[str, str] | Signal] | None
    outputs: Sequence[str | tuple[str, str] | Signal] | None
    initial: str | None
    rate: float | None
    decimal: str | None
    start: float | None
    step: float | None
    progress: Progress | None


@overload
def load(
    path: object, *, kind: Literal["frequency"], axes: str | None = None, **how: Unpack[Reading]
) -> FrequencyResponse: ...
@overload
def load(path: object, *, kind: Literal["time"], axes: None = None, **how: Unpack[Reading]) -> TimeRecord: ...
@overload
def load(
    path: object, *, kind: Literal["time"], axes: str, **how: Unpack[Reading]
) -> TimeRecord | list[TimeRecord]: ...
@overload
def load(path: object, *, kind: Literal["model"], axes: None = None, **how: Unpack[Reading]) -> control.StateSpace: ...
@overload
def load(path: object, *, kind: str | None = None, axes: str | None = None, **how: Unpack[Reading]) -> Any: ...


def load(
    path: object,
    *,
    kind: str | None = None,
    fields: Mapping[str, object] | None = None,
    dt: float | None = None,
    bound: ArrayLike | None = None,
    frequency_unit: str | None = None,
    inputs: Sequence[str | tuple[str, str] | Signal] | None = None,
    outputs: Sequence[str | tuple[str, str] | Signal] | None = None,
    initial: str | None = None,
    rate: float | None = None,
    axes: str | None = None,
    decimal: str | None = None,
    start: float | None = None,
    step: float | None = None,
    progress: Progress | None = None,
) -> Any:
    r"""Open a file: a saved result, an excitation, a model, or measurements from anywhere.

    Results are rebuilt from their numbers; every claim of an identification, the cost and the state space of a fit are verified
    again; `certified` and `verify` evaluate the certificates of bounds again. What was attained is read as it was found:
    certificates are there of the bounds.

    Parameters
    ----------
    path : str, path, or a table in memory
        * NAME, NAME.npz or NAME.json of an `Identification`, a `Band`, a `WorstCaseError`, a `WorstCaseOverPoles`, a `LoopBounds`,
          an `Interconnection`, a `ControllerDesign`, a `MatrixFraction`, a `Comparison`, `CommonModes` or a `Watch` that was
          saved; or the folder of a run, for its result;
        * ``.csv`` or ``.npz`` of an `Excitation`;
        * ``.npz`` or ``.mat`` with the matrices A, B, C and, optionally, D and dt (0: continuous) of a state-space model, or the
          numbers of a MATLAB model: a, b, c, d, or z, p, k, or num, den (one input, one output), in a structure too, with Ts;
        * measurements: tables of text of any ending (separator, decimal mark, lines of names and units are found, or the
          sentence says what to give; lines that start with ``#``, ``%``, ``!`` are remarks; columns whose headings say
          quantity, part, unit and sign, ``-Im(Z)/Ohm``, ``S21(DB)``, ``Zdq_phase_deg``, make the response or the matrix),
          ``.npy`` and ``.npz`` (pickled objects are refused), ``.mat`` (v4, v5 or v7.3), ``.h5`` (arrays in the axis order that
          h5py shows, numbers such as ``dt`` as attributes too, units in an attribute ``units``), universal files (data set 58:
          frequency responses and time responses, extra ``robustid[uff]``), Touchstone (``.s1p``, ``.s2p``, ...: S-parameters in
          continuous time, extra ``robustid[touchstone]``), transfer functions of LIGO's diagnostics test tools (``.xml``).
          Contents decide before the ending;
        * objects: a dictionary of arrays, an array of NumPy, a DataFrame or Series of pandas (a named index, or one of instants, is
          a column), a Dataset or DataArray of xarray (units in the attribute ``units``), a `control.FRD`.
    kind : {"frequency", "time", "model"}, optional
        What the file holds; default: by what was saved, by the roles in `fields`, else by the names in the file.
    fields : mapping, optional
        Role to name in the file. Frequency: ``omega`` or ``freq_hz``; ``values`` (complex), or ``real`` and
        ``imag``, or ``magnitude``/``magnitude_db`` and ``phase_deg``/``phase_rad``; ``bound``. Time:
        ``time``, ``u``, ``y``, ``reference``, ``bound``. Both: ``dt``. Fields of MATLAB structures have dots
        (``"data.u"``). Addresses are columns and slices, counted from 0 as in NumPy: ``"hairdryer[:,0]"``, ``"x[:,0:2]"``, and
        ``"[:,0]"`` of an array or a table of text without names; ``"other.npy[:,0]"`` and ``"other.mat:y"`` stand in another file
        of the same folder. MIMO: a list of names for a time signal; for a frequency role a list of
        rows (one an output) of names (one an input). Roles left out are looked for under usual names, upper
        or lower case, with or without a unit: ``frequency [Hz]``, ``f (kHz)``, ``omega [rad/s]``, ``magnitude [dB]``,
        ``phase [deg]``, ``time_ms``. Units of axes are converted; one that isn't known or isn't certain (``frequency``,
        ``phase`` alone) is refused. Structures with the fields of MATLAB's ``idfrd`` and ``frd`` (ResponseData, Frequency,
        FrequencyUnit, Ts, TimeUnit, CovarianceData, names) or ``iddata`` (OutputData, InputData, Ts) need no roles; covariances
        between different entries, of which ``idfrd`` says nothing, are zero then.
    dt : float, optional
        Sample time in s. Without it, a time record takes it from its ``time`` column, which must be uniform
        to 1e-6 of a step, and ``.npz`` and ``.mat`` files may hold it as a number named ``dt``, ``Ts`` or ``T``;
        with it, neither is read. Of a model: 0 for continuous time.
    bound : scalar or array, optional
        Bound on the errors; goes before a ``bound`` in the file.
    frequency_unit : {"rad/s", "Hz", "kHz"}, optional
        Unit of a frequency axis whose name doesn't say it; "rad/s" is taken for names such as ``omega`` only, and a
        column ``frequency`` without a unit is refused. A contradiction with the name is refused too.
    inputs, outputs : sequence of str or (name, unit), optional
        Names and units of the signals; default for time records: the column names.
    initial : {"rest", "free", "periodic"}, optional
        State before a time record (see `TimeRecord`); default "rest", or what `save` stored.
    rate : float, Hz, optional
        Sample rate in place of `dt`. In files: a number named ``fs`` or ``sample_rate``, or the role ``rate``.
    axes : str, optional
        Names of the axes of the arrays in their order: of ``time``, ``signal``, ``realisation`` and ``period``, or of
        ``frequency``, ``output`` and ``input`` (``"output,input,frequency"`` in MATLAB). With realisations a list of records comes
        back; periods follow each other in a record, which is in steady state unless `initial` says otherwise.
    decimal : {".", ","}, optional
        Decimal mark of a text, where its numbers don't say it.
    start, step : float, optional
        First frequency and distance of the others, in `frequency_unit`, of a response in a file that has no frequencies.
    progress : callable (text, done, count), optional
        Told how far the proofs of a saved design are, which are made anew; `show_progress` shows it.

    Returns
    -------
    Identification, WorstCaseError, WorstCaseOverPoles, MatrixFraction, Excitation, control.StateSpace, FrequencyResponse,
    TangentialResponse or TimeRecord
        Row and column vectors of MATLAB become (N,). Other axes of measurements are taken as they are, time or frequency
        first, where `axes` doesn't name them. The logger ``robustid`` says at the level INFO as what the file was read.

    Raises
    ------
    InputError
        No such file; a name isn't in the file (the sentence lists those that are), the time isn't uniform, wrong shapes; an
        argument about measurements for a file that holds something else.
    FileFormatError
        A broken, edited or foreign file, files that do not belong together, text where numbers are needed.

    Examples
    --------
    >>> import pathlib, tempfile, numpy as np, robustid as rid
    >>> record = rid.TimeRecord(np.eye(1, 2)[0], [0.5, 0.25], dt=1.0, bound=1e-3)
    >>> result = rid.identify(rid.MixedProblem(time=record, prior=rid.Prior(gain_bound=1.0, decay_rate=1.5)))
    >>> error = rid.worst_case_error(result, omega=[0.0, 1.0])
    >>> with tempfile.TemporaryDirectory() as name:
    ...     folder = pathlib.Path(name)
    ...     error.save(folder / "bounds")
    ...     again = rid.load(folder / "bounds")
    ...     _ = (folder / "step.csv").write_text("time,u,y\n0,1,0\n0.01,1,0.5\n0.02,1,0.75\n")
    ...     step = rid.load(folder / "step.csv", bound=0.01)
    >>> again.certified, bool(np.all(again.upper == error.upper))
    (True, True)
    >>> step.dt, step.y.ravel()
    (0.01, array([0.  , 0.5 , 0.75]))
    """
    from robustid.formats import read_file

    stated = {"dt": dt, "bound": bound, "inputs": inputs, "outputs": outputs, "initial": initial, "rate": rate,
              "axes": axes, "decimal": decimal, "start": start, "step": step}  # fmt: skip
    path = _of_name(path)
    if not _is_place(path) or saved_kind(path) is None:
        return read_file(path, kind=kind, fields=fields, frequency_unit=frequency_unit, **stated)
    for name, value in ({"kind": kind, "fields": fields, "frequency_unit": frequency_unit} | stated).items():
        if value is not None:
            raise InputError(f"`{name}` is about measurements, and {path} is a saved result; leave `{name}` out")
    return load_result(path, progress=as_function("progress", progress))


def _of_name(path: object) -> object:
    """NAME as NAME.npz, where only that is there: a model or measurements that were saved so."""
    if not _is_place(path) or os.path.exists(path) or saved_kind(path) is not None:
        return path
    numbers = paths(path)[0]
    return numbers if not os.path.splitext(path)[1] and numbers.is_file() else path


def _is_place(path: object) -> TypeGuard[str | os.PathLike[str]]:
    return isinstance(path, str | os.PathLike)


def load_result(path: str | os.PathLike[str], *kinds: str, progress: Progress | None = None) -> Any:
    """Load a saved result of one of these kinds ("identification", "matrix fraction", "worst-case error", "band over poles").

    Default: of any.
    """
    for room in (
        "advice",
        "controllers",
        "fitting",
        "guarantees",
    ):  # with them come all rooms that have results to load
        importlib.import_module(f"robustid.{room}")
    if os.path.isfile(path) and saved_kind(path) is None and not paths(path)[1].exists():
        raise FileFormatError(f"{path} is no saved result; robustid look {path} shows what it is, and how to go on")
    return load_saved(path, *kinds, progress=progress)


def save(
    path: str | os.PathLike[str],
    thing: object,
    *,
    parameter: str | None = None,
    reference: float | None = None,
    omega: ArrayLike | None = None,
) -> None:
    """Write a result, an excitation, a model or measurements, so that `load` gives back exactly the same.

    Every file appears whole or not at all; nothing is pickled.

    Parameters
    ----------
    path : str or path
        Of a result NAME, for NAME.npz (numbers) and NAME.json (everything else, readable), both or none. Of measurements ``.npz``;
        ``.csv`` with 17 digits: a first line ``# robustid {...}`` that describes it, column names, numbers; or ``.mat`` (v5): plain
        arrays of the same names, frequency or time first, `dt` (0 for continuous time) and the names of the signals. Of an
        excitation ``.csv`` or ``.npz``, of a model ``.npz`` or ``.mat`` with A, B, C, D, dt (0 for continuous time) and ``inputs``
        and ``outputs``, the names and units of its signals.
        For others' programs, of a model: a MATLAB script (``.m``), JSON (``.json``), a C header in double and single precision
        (``.h``, discrete), second-order sections (``.sos``, discrete) and zeros, poles and gain in Hz (``.zpk``, continuous) of one
        input and output, a table of its poles (``.csv``); of a controller C with output limits and anti-windup (``.c``, with its
        declarations in ``.h`` beside it, of a `ControllerDesign` or a discrete model; ``.h`` alone of a `ControllerDesign`); of
        an `UncertaintyWeight` the uncertain plant as a MATLAB script (``.m``: ss, ultidyn); of a response universal file 58
        (``.uff``, ``.unv``; extra ``robustid[uff]``); of a WorstCaseError its bounds, of an Identification its verdict as a table
        (``.csv``). Touchstone (``.s1p``, ``.s2p``, ...: version 1, real
        and imaginary parts; bounds have no place there) of a response or a model; a SPICE subcircuit (``.cir``, ``.sp``, ``.lib``,
        ``.sub``; controlled sources, resistors and capacitors) of a model that is passive.
    thing : object
        Identification, WorstCaseError, WorstCaseOverPoles, LoopBounds, Interconnection, ControllerDesign, MatrixFraction,
        Excitation, control.StateSpace, DelayedModel,
        UncertaintyWeight, FrequencyResponse, TangentialResponse or TimeRecord; of measurements with their bounds and what these
        mean, covariance, names of the signals and note.
    parameter : {"s", "z", "y"}, optional
        Of Touchstone and SPICE: the parameters that the thing holds, scattering (default), impedance or admittance. Files hold
        scattering.
    reference : float, ohm, optional
        Of Touchstone and SPICE: the reference resistance of all ports, default 50.
    omega : (F,) array, rad/s, optional
        Of a model in Touchstone, needed: its frequencies.

    Raises
    ------
    InputError
        Another ending, a folder that doesn't exist, a full disk; a network that isn't square or isn't continuous, a model for SPICE
        that isn't passive.
    InputTypeError
        Another object.

    Examples
    --------
    >>> import pathlib, tempfile, robustid as rid
    >>> frf = rid.FrequencyResponse([1.0, 2.0], [0.1 + 0.2j, 0.3j], bound=0.01, dt=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     rid.save(pathlib.Path(folder) / "frf.csv", frf)
    ...     again = rid.load(pathlib.Path(folder) / "frf.csv")
    >>> bool((again.values == frf.values).all())
    True
    """
    if is_network(path):
        from robustid.app.exports.network_files import save_network

        save_network(path, thing, parameter=parameter, reference=reference, omega=omega)
        return
    given = {"parameter": parameter, "reference": reference, "omega": omega}
    if names := [f"`{name}`" for name, value in given.items() if value is not None]:
        raise InputError(f"{names[0]} is for Touchstone (.s2p, ...) and SPICE (.cir, ...) files; got {str(path)!r}")
    from robustid.app.exports import exported

    if not exported(path, thing):
        save_one(path, thing)
