"""Many surfaces: the sheet, what became of each case, one run at a time, what jobs take, the folder's description."""
