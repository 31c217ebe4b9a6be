"""Studies behind figures in the documentation: calibration on virtual robots and on folders of campaigns, planning."""
