"""Solve the problems named on standard input with Siconos and write one line of JSON for each and each solver. Run by ``compare.py`` with the system's Python.

Time is that of the driver alone: the problem is in Siconos' own form before. The sparse-block form is used, which is the fastest for Gauss-Seidel; each time is the least of
several runs, until 0.3 s have gone by.
"""

import json
import sys
import time
import warnings

import numpy as np
import scipy.sparse as sp
import siconos.numerics as sn

SOLVERS = {
    "nsgs": (sn.SICONOS_FRICTION_3D_NSGS, 10000),
    "prox": (sn.SICONOS_FRICTION_3D_PROX, 1000),
    "nsn_ac": (sn.SICONOS_FRICTION_3D_NSN_AC, 1000),
    "admm": (sn.SICONOS_FRICTION_3D_ADMM, 20000),
}


def load(path):
    """W, q and mu of a file of either form."""
    z = np.load(path)
    if "W" in z.files:
        return sp.csr_matrix(z["W"]), z["W"], z["q"], z["mu"]
    w = sp.csr_matrix((z["W_data"], z["W_indices"], z["W_indptr"]), shape=tuple(int(side) for side in z["W_shape"]))
    return w, w.toarray(), z["q"], z["mu"]


def main():
    """Read paths, write results."""
    warnings.simplefilter("ignore")
    tolerance, limit = float(sys.argv[1]), float(sys.argv[2])
    for line in sys.stdin:
        path = line.strip()
        w, dense, q, mu = load(path)
        for name, (number, most) in SOLVERS.items():
            spent, best, info, r = 0.0, float("inf"), None, None
            while spent < min(limit, 0.3):
                matrix = sn.SBM_from_csparse(3, w)[1] if name == "nsgs" else dense if len(mu) < 30 else w.tocsc()
                problem = sn.FrictionContactProblem(3, len(mu), matrix, q, mu)
                options = sn.SolverOptions(number)
                options.dparam[0], options.iparam[0] = tolerance, most
                r, u = np.zeros_like(q), np.zeros_like(q)
                start = time.process_time()
                info = sn.fc3d_driver(problem, r, u, options)
                took = time.process_time() - start
                spent, best = spent + took + 1e-3, min(best, took)
            print(json.dumps({"path": path, "solver": name, "info": int(info), "cpu_s": best, "reactions": r.tolist()}), flush=True)


if __name__ == "__main__":
    main()
