from .diagnose import Diagnosis as Diagnosis
from .diagnose import DiagnosisOptions as DiagnosisOptions
from .suggest.next_measurements import suggest_measurements as suggest_measurements
