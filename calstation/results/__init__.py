"""Results of runs and logs: solving, judging, result files, history, hand-over, previews and plot data.

Devices, register transfers and the run itself do not belong here.
"""
