"""Statistical conventions that more than one module uses, each once, with its source. Knows numbers only.

A threshold of one test stands beside that test, where what it is of can be read.
"""

from __future__ import annotations

import math

MEDIAN_SIZE = 0.6745  # median of |z| of a standard normal z: median(|x|) / it is a deviation (Hampel 1974)
SECOND_DIFFERENCE = math.sqrt(6)  # deviation of y[k+1] - 2 y[k] + y[k-1] of white noise, over the noise's (1 + 4 + 1)
STEP_DEVIATION = math.sqrt(12)  # a quantiser's step over the deviation of its error, uniform within the step
CONFIDENCE = 0.95  # of an interval where nobody asks for another
OUTLIER = 3.5  # modified z-score (Iglewicz and Hoaglin 1993): one of 2 150 normal values is beyond
FALSE_TREND = 0.01  # chance of calling a trend what is none
