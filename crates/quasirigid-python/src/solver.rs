//! `ContactSolution`, and what `quasirigid.solve_contacts` and `World.contact_problem` are made of.

use crate::conv;
use crate::errors::{OrRaise, to_py};
use crate::report::stop_name;
use numpy::{AllowTypeChange, PyArray1, PyArrayLike1, PyArrayLike3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid::gauss_seidel::SolverParameters;
use quasirigid::math::{Mat3, Real, Vec3};
use quasirigid::solve_system::{ContactSystem, SystemSolution, solve_system_until};
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

#[doc = doc!("ContactSolution")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct ContactSolution {
    solution: SystemSolution,
    asymmetry: Real,
    time: Duration,
}

fn flat<'py>(py: Python<'py>, vectors: &[Vec3]) -> Bound<'py, PyArray1<Real>> {
    conv::from_vec(py, vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect())
}

#[pymethods]
impl ContactSolution {
    #[doc = doc!("ContactSolution.reactions")]
    #[getter]
    fn reactions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        flat(py, &self.solution.reactions)
    }

    #[doc = doc!("ContactSolution.velocities")]
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Real>> {
        flat(py, &self.solution.velocities)
    }

    #[doc = doc!("ContactSolution.status")]
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        conv::from_vec(py, self.solution.status.iter().map(|&s| s as u8).collect())
    }

    #[doc = doc!("ContactSolution.residual")]
    #[getter]
    fn residual(&self) -> Real {
        self.solution.residual
    }

    #[doc = doc!("ContactSolution.unit_free_residual")]
    #[getter]
    fn unit_free_residual(&self) -> Real {
        self.solution.unit_free_residual
    }

    #[doc = doc!("ContactSolution.sweeps")]
    #[getter]
    fn sweeps(&self) -> u32 {
        self.solution.sweeps
    }

    #[doc = doc!("ContactSolution.newton_steps")]
    #[getter]
    fn newton_steps(&self) -> u32 {
        self.solution.newton_steps
    }

    #[getter]
    fn converged(&self) -> bool {
        self.solution.stop.converged()
    }

    #[doc = doc!("ContactSolution.stop_reason")]
    #[getter]
    fn stop_reason(&self) -> &'static str {
        stop_name(self.solution.stop)
    }

    #[doc = doc!("ContactSolution.asymmetry")]
    #[getter]
    fn asymmetry(&self) -> Real {
        self.asymmetry
    }

    #[doc = doc!("ContactSolution.time")]
    #[getter]
    fn time(&self) -> f64 {
        self.time.as_secs_f64()
    }

    #[doc = doc!("ContactSolution.__len__")]
    fn __len__(&self) -> usize {
        self.solution.reactions.len()
    }

    fn __repr__(&self) -> String {
        let s = &self.solution;
        let (n, stop) = (s.reactions.len(), stop_name(s.stop));
        format!("ContactSolution({n} contacts, {stop}, residual={:.2e}, sweeps={})", s.residual, s.sweeps)
    }
}

/// `W` with all its entries, `(3n, 3n)`.
fn dense_system(w: &Bound<'_, PyAny>, q: &[Real], mu: &[Real]) -> PyResult<ContactSystem> {
    let py = w.py();
    let width = 3 * mu.len();
    let w = conv::real_array(w, "W", &format!("({width}, {width})"))?;
    if w.shape() != [width, width] {
        let hint = "W has three rows and columns per contact, mu one number";
        return Err(to_py(py, &Error::shape("W", format!("shape ({width}, {width})"), format!("shape {:?}", w.shape()), hint)));
    }
    match w.as_slice() {
        Ok(numbers) if w.is_c_contiguous() => ContactSystem::from_dense(numbers, q, mu).or_raise(py),
        _ => {
            let numbers: Vec<Real> = w.as_array().iter().copied().collect();
            ContactSystem::from_dense(&numbers, q, mu).or_raise(py)
        }
    }
}

/// `W` in the arrays of a canonical `scipy.sparse.bsr_array` with 3x3 blocks, which `quasirigid.arrays.sparse` has checked.
fn block_system(rows: &BlockRows<'_>, q: &[Real], mu: &[Real]) -> PyResult<ContactSystem> {
    let (starts, columns, blocks) = rows;
    let py = blocks.py();
    let refuse =
        |got: String| to_py(py, &Error::value("W", "row pointers and block columns of a matrix", got, "give a SciPy sparse matrix"));
    let starts = starts.as_array().iter().map(|&k| usize::try_from(k).map_err(|_| refuse(k.to_string()))).collect::<PyResult<_>>()?;
    let columns = columns.as_array().iter().map(|&j| u32::try_from(j).map_err(|_| refuse(j.to_string()))).collect::<PyResult<_>>()?;
    if blocks.shape()[1..] != [3, 3] {
        return Err(refuse(format!("blocks of shape {:?}", &blocks.shape()[1..])));
    }
    let values = blocks.as_array().outer_iter().map(|b| Mat3::from_fn(|r, c| b[(r, c)])).collect();
    ContactSystem::from_block_rows(starts, columns, values, q, mu).or_raise(py)
}

/// Row pointers, block columns and blocks `(k, 3, 3)`.
type BlockRows<'py> =
    (PyArrayLike1<'py, i64, AllowTypeChange>, PyArrayLike1<'py, i64, AllowTypeChange>, PyArrayLike3<'py, Real, AllowTypeChange>);

/// How long a Ctrl-C may go unseen.
const SIGNALS_EVERY: Duration = Duration::from_millis(20);

/// Looks for signals while the solver runs without the GIL.
struct Signals {
    seen: Cell<Instant>,
    error: RefCell<Option<PyErr>>,
}

impl Signals {
    fn new(start: Instant) -> Self {
        Self { seen: Cell::new(start), error: RefCell::new(None) }
    }

    /// Whether Python wants the call to end, by an exception of a signal handler.
    fn arrived(&self) -> bool {
        if self.error.borrow().is_some() {
            return true;
        }
        if self.seen.get().elapsed() < SIGNALS_EVERY {
            return false;
        }
        let error = Python::attach(|py| py.check_signals()).err();
        self.seen.set(Instant::now());
        let arrived = error.is_some();
        self.error.replace(error);
        arrived
    }
}

/// Solves; `w` is either a dense matrix or the triple of [`BlockRows`].
#[pyfunction]
#[allow(clippy::too_many_arguments)] // of solve_contacts, which has keywords
pub fn _solve_contacts(
    py: Python<'_>,
    w: &Bound<'_, PyAny>,
    q: &Bound<'_, PyAny>,
    mu: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = conv::real)] tolerance: Real,
    max_sweeps: conv::Whole,
    #[pyo3(from_py_with = conv::optional_real)] time_budget: Option<Real>,
    warm_start: Option<&Bound<'_, PyAny>>,
) -> PyResult<ContactSolution> {
    let start = Instant::now();
    let (q, mu) = (conv::vector(q, "q")?, conv::vector(mu, "mu")?);
    let max_sweeps = conv::count_from(py, "max_sweeps", max_sweeps, 1)?.try_into().unwrap_or(u32::MAX);
    let mut parameters = SolverParameters { tolerance, max_sweeps, min_sweeps: 1, ..SolverParameters::default() };
    if let Some(budget) = time_budget {
        quasirigid::error::check_positive("time_budget", budget, "s").or_raise(py)?;
        parameters.time_budget = Duration::try_from_secs_f64(budget).ok();
    }
    let warm_start = match warm_start {
        Some(r) => {
            let r = conv::vector(r, "warm_start")?;
            if r.len() != q.len() {
                let hint = "give the reactions of a problem with the same contacts";
                return Err(to_py(py, &Error::shape("warm_start", format!("shape ({},)", q.len()), format!("shape ({},)", r.len()), hint)));
            }
            Some(r.chunks_exact(3).map(Vec3::from_column_slice).collect::<Vec<_>>())
        }
        None => None,
    };
    let system = match w.extract::<BlockRows<'_>>() {
        Ok(rows) => block_system(&rows, &q, &mu)?,
        Err(_) => dense_system(w, &q, &mu)?,
    };
    // Reading a large W takes time too.
    parameters.time_budget = parameters.time_budget.map(|budget| budget.saturating_sub(start.elapsed()));
    let (solution, interrupt) = py.detach(|| {
        let signals = Signals::new(start);
        let solution = solve_system_until(&system, &parameters, warm_start.as_deref(), Some(&|| signals.arrived()));
        (solution, signals.error.into_inner())
    });
    if let Some(error) = interrupt {
        return Err(error);
    }
    let solution = solution.or_raise(py)?;
    Ok(ContactSolution { solution, asymmetry: system.asymmetry(), time: start.elapsed() })
}

/// The contact problem of the last step, as a `quasirigid.solver.ContactProblem`.
pub fn contact_problem<'py>(py: Python<'py>, world: &quasirigid::World, sparse: bool) -> PyResult<Bound<'py, PyAny>> {
    let problem = world.contact_problem();
    let w = problem.assembled().or_raise(py)?;
    let (q, reactions) = problem.coulomb_part();
    let (q, reactions) = (flat(py, &q), flat(py, &reactions));
    let mu = conv::from_vec(py, problem.mu.clone());
    let matrix = if sparse {
        let (mut starts, mut columns, mut blocks) = (vec![0i64], Vec::new(), Vec::new());
        for i in 0..problem.len() {
            for (j, block) in w.row(i) {
                columns.push(j as i64);
                blocks.push(*block);
            }
            starts.push(columns.len() as i64);
        }
        let arrays = (conv::from_vec(py, starts), conv::from_vec(py, columns), conv::from_matrices(py, blocks)?);
        py.import("quasirigid.arrays.sparse")?.getattr("from_block_rows")?.call1(arrays)?
    } else if problem.is_empty() {
        // A reshape to no columns is refused.
        numpy::PyArray2::<Real>::zeros(py, [0, 0], false).into_any()
    } else {
        conv::rows(py, w.to_dense(), 3 * problem.len())?.into_any()
    };
    py.import("quasirigid.solver")?.getattr("ContactProblem")?.call1((matrix, q, mu, reactions))
}
