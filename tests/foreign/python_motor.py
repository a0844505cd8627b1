"""A DC motor in Python, as pythonfmu packs it: Runge and Kutta's method of order four in 20 substeps."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class PythonMotor(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.Ra, self.La, self.Kt, self.Jm, self.d = 3.0, 0.012, 0.05, 1e-5, 1.5e-4
        self.u, self.ia, self.w = 0.0, 0.0, 0.0
        for name in ("Ra", "La", "Kt", "Jm", "d"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("ia", causality=Fmi2Causality.output))
        self.register_variable(Real("w", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        h = step_size / 20
        ia, w = self.ia, self.w
        for _ in range(20):
            a, b = ia, w
            for part in (h / 4, h / 3, h / 2, h):  # of a linear model it is Taylor's series
                a, b = (
                    ia + part * (self.u - self.Ra * a - self.Kt * b) / self.La,
                    w + part * (self.Kt * a - self.d * b) / self.Jm,
                )
            ia, w = a, b
        self.ia, self.w = ia, w
        return True
