"""What the engine does not do yet: each of these tests is an expected failure, with its reason (`pytest -m open`).

A key is a test, or one of its cases, as pytest names it. A test that passes again is to be taken out of this table: it
is then one of the default suite.
"""

OPEN = {
    "test_derived.py::test_speed_alone_tells_no_parameter_but_the_speed_per_volt": (
        "the speed per volt of speed alone has a bar of 0.5 % instead of 0.2: a dry friction is not excluded"
    ),
    "test_containment.py::test_after_a_kill_of_the_owner_workers_and_folder_go_within_two_seconds": (
        "a kill while the workers are still probing: one time in three the folder stays until the next start removes it"
    ),
    "test_odd_recordings.py::test_an_angle_of_a_motor_that_runs_already_may_begin_anywhere[levels2-counts]": (
        "112.08 counts a sample: their rounding repeats, and the first rows ask for other parameters"
    ),
    "test_refusal.py::test_an_impossible_acceleration": "of six samples lost in the steepest part some three are told",
    "test_trust.py::test_lost_samples_of_a_logger_that_averages_are_put_back": "a mean over the gap",
    "test_trust.py::test_a_wrong_assumption_is_named[speed shown 0.5 to 3 ms late]": "a lag and dry friction are named",
    "test_trust.py::test_a_gain_between_speed_and_angle_is_estimated_where_both_are_compared": (
        "the gain is right, a rival that differs is told besides"
    ),
    "test_nuisance.py::test_ripple_locked_to_the_angle_is_taken_out": (
        "the order is found and named; its amplitude is told at the largest current, with the noise too large beside it"
    ),
    "test_nuisance.py::test_a_declared_filter_is_applied_to_the_model_too": (
        "noise behind a declared Chebyshev filter is not whitened: neighbours correlate by 0.4; doubtful"
    ),
}
