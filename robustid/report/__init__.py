"""What people see: plots, a summary at the terminal, and a report as one HTML page."""

from robustid.report.frf_plots import plot_frf
from robustid.report.html import render_report, write_report
from robustid.report.margin_by_order import plot_margins
from robustid.report.mfd_plots import plot_convergence, plot_fit, plot_fit_poles, plot_orders, plot_stabilisation
from robustid.report.mfd_view import FitView
from robustid.report.plots import plot_frequency_response, plot_hankel, plot_poles, plot_residuals, plot_time_response
from robustid.report.poles import PoleRow, pole_table
from robustid.report.text import render_summary
from robustid.report.worst_case_facts import at_most, same
from robustid.report.worst_case_plots import plot_nyquist, plot_tube, plot_worst_case

__all__ = [
    "FitView",
    "PoleRow",
    "at_most",
    "plot_convergence",
    "plot_fit",
    "plot_fit_poles",
    "plot_frequency_response",
    "plot_frf",
    "plot_hankel",
    "plot_margins",
    "plot_nyquist",
    "plot_orders",
    "plot_poles",
    "plot_residuals",
    "plot_stabilisation",
    "plot_time_response",
    "plot_tube",
    "plot_worst_case",
    "pole_table",
    "render_report",
    "render_summary",
    "same",
    "write_report",
]
