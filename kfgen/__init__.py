"""kfgen: from a log of a real sensor to a Kalman filter that is proven on its target.

The conventions of the whole package are stated here and nowhere else.

Units
    SI and radians inside. Units are converted where data comes in (`readers`,
    files) and where it goes out (`report`, the command line), by `kfgen.core.units`.
Frames
    ``b`` body (x forward, y right, z down), ``n`` navigation: local level,
    north-east-down. A vector carries its frame as suffix, ``v_n``. A rotation
    ``R_nb`` takes body coordinates to navigation coordinates: ``v_n = R_nb v_b``.
Quaternions
    Scalar first, Hamilton product, ``q_nb`` body to navigation frame.
Errors
    true = estimate "plus" error: additive for vectors, ``R_nb = Exp(phi) R_nb_hat``
    for attitudes, so that ``phi`` has navigation axes (the phi-angle convention).
    Other conventions are chosen by name (`kfgen.model.symbols.convention`); so are Earth
    axes as navigation axes, in which ``n`` stands for them.
Noise
    Densities are two-sided (IEEE Std 952-1997, annex C): white noise ``N`` has the
    power spectral density ``N**2`` and, sampled every ``dt``, the standard
    deviation ``N / sqrt(dt)``.
Paper letters
    ``F`` dynamics, ``G`` noise input, ``H`` measurement, ``P`` covariance, ``Phi``
    transition, ``Qd`` discrete process noise, ``R`` measurement noise,
    ``S`` innovation covariance, ``K`` gain; ``n`` samples, ``dt`` sampling period.
"""

__version__ = "0.1.0"

__all__ = ["__version__"]
