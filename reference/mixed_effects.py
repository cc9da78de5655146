"""Mixed effects by statsmodels (restricted maximum likelihood), for `trocar::fleet::mixed`.

    python reference/mixed_effects.py > crates/trocar/tests/data/mixed_effects.json

Needs statsmodels (made with 0.15.0) and pandas. Values are drawn with a fixed seed; no error of measurement, which MixedLM does not know.
"""

import json

import numpy as np
import pandas as pd
import statsmodels.api as sm


def case(seed, sizes, between, within, means):
    random = np.random.default_rng(seed)
    rows = []
    for specimen, size in enumerate(sizes):
        kind = specimen % len(means)
        level = means[kind] + between * random.standard_normal()
        rows += [(kind, specimen, level + within * random.standard_normal()) for _ in range(size)]
    frame = pd.DataFrame(rows, columns=["kind", "specimen", "value"])
    design = np.array([[1.0 if kind == k else 0.0 for k in range(len(means))] for kind in frame.kind])
    fitted = sm.MixedLM(frame.value, design, groups=frame.specimen).fit(reml=True, method=["powell", "lbfgs"])
    return {
        "observations": [[int(k), int(s), float(v)] for k, s, v in rows],
        "between": float(np.sqrt(fitted.cov_re.iloc[0, 0])),
        "within": float(np.sqrt(fitted.scale)),
        "means": [float(m) for m in fitted.fe_params],
        "standard_errors": [float(e) for e in fitted.bse_fe],
    }


cases = [
    case(1, [6] * 12, 0.3, 0.1, [3.0, 2.0]),
    case(2, [3, 9, 4, 7, 5, 8, 6, 2], 0.5, 0.5, [1.0]),
    case(5, [4, 12, 5, 3, 6, 9, 4, 7, 8, 10, 3, 5], 0.8, 0.3, [3.0, 2.0, 5.0]),
]
print(json.dumps(cases))
