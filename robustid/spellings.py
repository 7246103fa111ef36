"""Names that engineers type, of other programs or of parts of this one, and what they mean here."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

# Of the front door: what is meant, and every spelling of it.
_TYPED = {
    "plot.bode": "bode bode_plot plot_bode bodeplot bodemag frequency_plot sigma",
    "plot.nyquist": "nyquist nyquist_plot nyquistplot",
    "plot.poles": "pzmap pzplot pole_plot",
    "plot.record": "plot_record plot_time time_plot plot_data",
    "plot.time_response": "step impulse lsim step_response impulse_response simulate sim",
    "plot.of": "show draw",
    "plot.residuals": "residuals",
    "fit_mfd": "fit fit_frf fit_tf fit_model fit_poles vectfit vector_fit vector_fitting rationalfit rational_fit aaa tfest"
    " estimate_tf ssest ssest_frf n4sid invfreqs invfreqz subspace polymax pole_residue modal_analysis ssi",
    "fit_records": "oe arx armax arma bj pem era okid output_error fit_time",
    "estimate_frf": "etfe spa spafdr tfestimate frf welch csd psd coherence cohere estimate fft estimate_response",
    "FrequencyResponse": "FRD frd idfrd frequency_response freqresp FRF",
    "TimeRecord": "iddata record time_record Record timeseries signal",
    "estimate_bound": "noise noise_level error_bound uncertainty bound_from_data",
    "guarantee.uncertainty_weight": "ucover uss weight",
    "guarantee.robust_stability_margin": "robstab margin mussv mu",
    "loop_bounds": "margins allmargin diskmargin disk_margins stability_margins sensitivity_peak loopsens"
    " stability peak_sensitivity robust_stability",
    "design_controller": "pidtune looptune systune hinfstruct hinfsyn hinf mixsyn musyn h2syn lqr controller tune autotune"
    " design_pid pid_tune synthesize synthesise pid pi tune_pid pid_design",
    "guarantee.nu_gap": "gapmetric gap distance vinnicombe nugap gap_metric nugapmetric",
    "guarantee.ncf_margin": "ncfmargin",
    "guarantee.step_tube": "step_bounds step_range step_envelope closed_loop_step",
    "Loop": "loop closed_loop feedback controller_that_ran",
    "interconnection": "connect interconnect source_load impedance_ratio minor_loop",
    "run": "fleet batch run_all run_file pipeline",
    "advise.common_modes": "setups merge merge_setups compare_modes roving combine",
    "design.Notch": "notch notch_filter",
    "design.LeadLag": "lead lag lead_lag",
    "design.Limits": "limits specs requirements",
    "band": "uncertain_plant envelope",
    "guarantee.coprime": "rncf lncf",
    "reduce_within_bounds": "reduce reduce_order reduce_model modred",
    "balanced_truncation": "balred hsvd balreal balance truncate",
    "to_continuous": "d2c continuous d2cm",
    "load": "read open read_csv load_model load_csv load_data loadmat read_mat read_frf read_touchstone from_csv from_mat"
    " import_data",
    "save": "write save_model export to_csv to_matlab to_mat to_c to_spice write_csv write_mat write_spice export_c export_matlab"
    " export_spice savemat dump",
    "write_report": "html to_html publish",
    "diagnose": "help_me why explain",
    "fits.mode_table": "modes poles damp eigenfrequencies natural_frequencies modal_parameters",
    "fits.suggest_order": "order choose_order select_order stabilisation_diagram stabilization_diagram selstruc",
    "kautz": "Kautz laguerre basis obf",
    "passive.make_passive": "enforce_passivity enforce_passive",
    "validate": "resid goodnessOfFit goodness_of_fit nrmse crossval validate_model",
    "refute": "falsify invalidate",
    "watch": "monitor health drift track detect_change condition_monitoring anomaly alarm changed fault_detection",
    "worst_case_error": "bounds wcgain error_bounds model_error hinfnorm",
    "compare": "diff difference same isequal compare_records compare_responses",
    "prepare.multisine": "idinput chirp prbs excitation schroeder",
    "prepare.detrend": "remove_mean",
    "prepare.decimate": "resample downsample",
    "identify": "sysid setmem set_membership",
}
MEANT = {typed: meant for meant, words in _TYPED.items() for typed in words.split()}

# Of the command line: the command that does what a name at the front door does, and words for commands alone.
_COMMANDS = {
    "look": "load record_faults describe info inspect head print cat check check_data quality",
    "identify": "identify identify_reduced guarantee.contradiction id ident identification model estimate_model",
    "new": "init create template config project",
    "run": "run",
    "demo": "example examples tutorial start hello quickstart",
    "excite": "prepare.multisine generate signal design_excitation experiment",
    "frf": "estimate_frf FrequencyResponse response transfer spectrum",
    "fit": "fit_mfd fit_records fits.mode_table fits.suggest_order plot.poles train regress",
    "bounds": "worst_case_error band guarantee.uncertainty_weight estimate_bound bound error guarantee",
    "reduce": "reduce_within_bounds balanced_truncation simplify shrink",
    "compare": "compare advise.common_modes validate vs",
    "verify": "proof prove certify certificate audit check_proof",
    "refute": "refute contradict test",
    "watch": "watch fault detect supervise",
    "report": "write_report plot plot.bode plot.nyquist plot.of plot.record plot.residuals plot.time_response page pdf view"
    " summary",
    "export": "save to_continuous convert code codegen c header matlab spice simulink",
    "explore": "gui app ui live dashboard interactive browser web studio",
    "loop": "loop_bounds guarantee.robust_stability_margin guarantee.step_tube Loop nyquist_margin",
    "connect": "interconnection cascade stability_of_pair",
    "control": "design_controller design.Notch design.LeadLag design.Limits design synth",
    "serve": "mcp server api rpc agent",
}
_BY_WORD = {word: command for command, words in _COMMANDS.items() for word in words.split()}

# Of data and results: (attribute that is there, what to write) for a word that isn't; the first attribute that the object has.
_DATA_WORDS = {
    "freq frequency frequencies f freqs hz f_hz": (("freq_hz", ""), ("omega", ""), ("modes", "")),
    "w angular_frequency rad_s": (("omega", ""),),
    "t times": (("time", ""),),
    "fs Fs sample_rate rate Ts ts sample_time samplerate sampling_time": (("dt", ""),),
    "input in_ force x": (("u", ""),),
    "output out": (("y", ""),),
    "H G response frdata fresp data complex": (("values", ""), ("model", "")),
    "mag magnitude gain abs amplitude": (("values", "numpy.abs({}.values)"),),
    "phase angle": (("values", "numpy.angle({}.values)"),),
    "error errors std sigma uncertainty tolerance noise_level": (("bound", ""), ("upper", "")),
    "length samples n_samples nsamples size": (("u", "len({}.u)"), ("omega", "{}.omega.size")),
    "order n nstates states degree": (("order", ""), ("model", "{}.model.nstates")),
    "poles pole eig eigenvalues": (("poles", ""), ("model", "{}.model.poles()")),
    "zeros zero": (("model", "{}.model.zeros()"),),
    "A B C D": (("model", "{}.model"),),
    "ss sys system state_space statespace to_ss plant tf transfer_function transferfunction to_tf nominal": (
        ("model", ""),
    ),
    "modes wn zeta damping damp eigenfrequencies natural_frequencies mode_table frequencies_hz": (
        ("modes", ""),
        ("model", "robustid.fits.mode_table({})"),
    ),
    "frd to_frd to_FRD": (("to_control", "{}.to_control()"),),
    "plot_bode bode show draw figure graph bodeplot": (("plot", "{}.plot()"),),
    "print report describe text info": (("summary", "{}.summary()"),),
    "export to_file write dump to_csv to_mat to_npz store": (("save", "{}.save(path)"),),
    "df dataframe to_pandas frame pandas as_dataframe rows": (("to_dataframe", "{}.to_dataframe()"),),
    "between slice crop cut limit filter range": (
        ("band", "{}.band(low_hz, high_hz)"),
        ("window", "{}.window(start, stop)"),
    ),
    "channel siso select_channel pick": (("entry", "{}.entry(output, input)"),),
    "different changed equal same p p_value pvalue": (("differ", ""), ("by_chance", "")),
    "ok valid feasible success is_consistent": (("consistent", ""), ("certified", ""), ("stable", "")),
    "K controller_model C_": (("controller", ""),),
}
_ATTRIBUTES = {word: places for words, places in _DATA_WORDS.items() for word in words.split()}


def meant(name: str, known: Mapping[str, str]) -> str | None:
    """Name at the front door that a typed one means: `known` ones by their last part, those of other programs, the nearest."""
    if (found := known.get(name) or MEANT.get(name)) is not None:
        return found
    near = difflib.get_close_matches(name, known, 1, 0.75)
    return known[near[0]] if near else None


def command_meant(typed: str) -> str | None:
    """Command that a typed word means: one of the field's, a name at the front door or one that means it; the nearest of those."""
    word = typed.replace("-", "_")
    if (found := _command_of(word) or _command_of(word.lower())) is not None:
        return found
    if difflib.get_close_matches(word, _COMMANDS):  # misspelt: told as such
        return None
    near = difflib.get_close_matches(word.lower(), [*_BY_WORD, *MEANT], 1, 0.75)
    return _command_of(near[0]) if near else None


def _command_of(word: str) -> str | None:
    return _BY_WORD.get(word) or _BY_WORD.get(MEANT.get(word, ""))


def attribute_words(thing: Any, name: str, front: Any) -> str:
    """Return what leads on from an attribute that an object has not, as the end of a sentence."""
    kind = type(thing).__name__
    own = [one for one in dir(type(thing)) + list(vars(thing)) if one[:1].islower()]
    said = _of_object(name, own)
    if said is None:
        near = difflib.get_close_matches(name, own, 1, 0.75)
        said = f"{{}}.{near[0]}" if near else None
    if said is None and (function := meant(name, front)) is not None:
        said = f"robustid.{function}({{}})"
    if said is None or name.startswith("_"):
        return f"a {kind} has no {name!r}; it has {', '.join(sorted(set(own)))}"
    return f"a {kind} has no {name!r}; {said.format(_LETTERS.get(kind, 'result'))} is what you look for"


_LETTERS = {"FrequencyResponse": "frf", "TimeRecord": "record", "MatrixFraction": "fit", "RecordFit": "fit"}


def _of_object(name: str, own: Iterable[str]) -> str | None:
    for attribute, words in _ATTRIBUTES.get(name, ()):
        if attribute in own:
            return words or f"{{}}.{attribute}"
    return None
