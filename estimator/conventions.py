"""Statistical conventions that more than one module uses, each once, with its source. Knows numbers only.

A threshold of one test stands beside that test, where what it is of can be read. A chance is that of a finding where
there is nothing to find.
"""

from __future__ import annotations

import math

# Deviations
MEDIAN_SIZE = 0.6745  # median of |z| of a standard normal z: median(|x|) / it is a deviation (Hampel 1974)
SECOND_DIFFERENCE = math.sqrt(6)  # deviation of y[k+1] - 2 y[k] + y[k-1] of white noise, over the noise's (1 + 4 + 1)
STEP_DEVIATION = math.sqrt(12)  # a quantiser's step over the deviation of its error, uniform within the step
NUMERICAL = 1e-6  # of a signal's deviation: smaller residuals are the simulation's arithmetic, no noise and no misfit
RESOLVED = 0.75  # of a sensor's step: a smaller residual is explained as well as the sensor resolves it

# Outliers
HUBER = 1.345  # deviations: 95 % of the efficiency of least squares on normal noise (Huber 1964)
T_FREEDOM = 4.0  # degrees of freedom of Student's t that weighs outliers (Lange, Little and Taylor 1989)
T_MEDIAN = 0.741  # median of |t| of these degrees of freedom, as MEDIAN_SIZE of a normal one
MODIFIED_Z = 3.5  # of one value among some (Iglewicz and Hoaglin 1993): one of 2 150 normal values is beyond

# Tests
CONFIDENCE = 0.95  # of an interval where nobody asks for another
FALSE_ALARM = 1e-3  # chance that one kind of test finds something wrong; its single tests share it (Bonferroni)
FALSE_TREND = 0.01  # chance of calling a trend what is none
STANDS_OUT = 20.0  # power of a line over the median nearby: one of 2^20 in white noise (two normal parts, exponential)
SMALL_CORRELATION = 0.08  # of neighbours: errors that neglect it are 8 % too small, by sqrt(1.08 / 0.92) (AR(1))
MISFIT = 1.5  # residuals' deviation over the noise's: by chance (chi-square) 1 in 900 of 20 samples, 1 in 1e5 of 40
LEAST_FALL = 10.0  # of -2 log L, by which a component of the noise must lower it: two numbers, and a margin

# What a recording tells
USELESS_ERROR = 0.5  # relative standard error: a parameter or quantity is not identified
NOTHING_TOLD = 100.0  # relative standard error: the recording says nothing of the value, not even its power of ten
TOLD_POWER = 0.003  # of an effect's power: if less is left beside the parameters, no such recording tells it
