"""Diagnosis: from the residual to the effect that the model lacks, and the error before and after."""

from elid_cli.diagnosis.diagnose import DiagnoseOptions, diagnose
from elid_cli.diagnosis.result import Diagnosis, FoundEffect, Rival, Unexplained

__all__ = ["DiagnoseOptions", "Diagnosis", "FoundEffect", "Rival", "Unexplained", "diagnose"]
