"""Studies behind figures of the documentation: calibration on virtual robots and on folders of campaigns, planning."""
