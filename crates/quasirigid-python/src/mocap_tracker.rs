//! `HandTracker` and `HandTargets`: a tracked hand at any time. Rows 0 to 4 are thumb to little finger, row 5 is the palm.

use crate::conv;
use crate::mocap::OrRaiseMocap;
use crate::mocap_calibration::Calibration;
use crate::mocap_frame::HandFrame;
use crate::mocap_parts::{PALM, PARTS, named_side, positions, quaternions};
use crate::process::ForkMutex;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quasirigid_mocap as mocap;
use quasirigid_mocap::{Delay, Finger, Pose, TargetState};

/// Places (6, 3) and directions (6, 3).
type Places<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[doc = doc!("HandTracker")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandTracker {
    tracker: ForkMutex<mocap::HandTracker>,
}

#[pymethods]
impl HandTracker {
    #[new]
    #[pyo3(signature = (side = "right", *, calibration = None, delay = None, hold = 0.5, fade = 0.5, catch = 0.1))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = conv::text)] side: &str,
        calibration: Option<&Calibration>,
        #[pyo3(from_py_with = conv::optional_real)] delay: Option<f64>,
        #[pyo3(from_py_with = conv::real)] hold: f64,
        #[pyo3(from_py_with = conv::real)] fade: f64,
        #[pyo3(from_py_with = conv::real)] catch: f64,
    ) -> PyResult<Self> {
        let side = named_side(py, side)?;
        let options = mocap::TrackingOptions { delay: delay.map_or(Delay::Auto, Delay::Fixed), hold, fade, catch };
        let pose = calibration.map_or_else(Pose::identity, |c| c.calibration.world_from_tracker);
        let tracker = mocap::HandTracker::new(side, pose, options).or_raise(py)?;
        Ok(Self { tracker: ForkMutex::new("hand tracker", tracker) })
    }

    #[doc = doc!("HandTracker.push")]
    fn push(&self, py: Python<'_>, frame: &HandFrame) -> PyResult<()> {
        let pushed = self.tracker.lock(py)?.push(&frame.frame);
        pushed.or_raise(py)
    }

    #[doc = doc!("HandTracker.sample")]
    fn sample(&self, py: Python<'_>, #[pyo3(from_py_with = conv::real)] now: f64) -> PyResult<Option<HandTargets>> {
        mocap::error::check_within("now", now, -1e12, 1e12, "s").or_raise(py)?;
        let targets = self.tracker.lock(py)?.sample(now);
        Ok(targets.map(|targets| HandTargets { targets }))
    }

    #[getter]
    fn side(&self, py: Python<'_>) -> PyResult<&'static str> {
        Ok(self.tracker.lock(py)?.side().name())
    }

    #[doc = doc!("HandTracker.delay")]
    #[getter]
    fn delay(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.tracker.lock(py)?.delay())
    }

    fn __copy__(&self, py: Python<'_>) -> PyResult<Self> {
        let tracker = self.tracker.lock(py)?.clone();
        Ok(Self { tracker: ForkMutex::new("hand tracker", tracker) })
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__(py)
    }

    #[doc = doc!("HandTracker.dropped")]
    #[getter]
    fn dropped<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let counts = self.tracker.lock(py)?.dropped();
        let parts = PyDict::new(py);
        for (part, poses) in Finger::ALL.map(Finger::name).into_iter().chain(["palm"]).zip(counts.poses) {
            if poses > 0 {
                parts.set_item(part, poses)?;
            }
        }
        let of = PyDict::new(py);
        of.set_item("frames", counts.frames)?;
        of.set_item("parts", parts)?;
        for (what, count) in
            [("jumps", counts.jumps), ("exchanged", counts.exchanged), ("flipped", counts.flipped), ("relocations", counts.relocations)]
        {
            of.set_item(what, count)?;
        }
        Ok(of)
    }
}

#[doc = doc!("HandTargets")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandTargets {
    targets: mocap::HandTargets,
}

impl HandTargets {
    fn parts(&self) -> [Option<mocap::Target>; PARTS] {
        std::array::from_fn(|k| if k == PALM { self.targets.palm } else { self.targets.fingers[k] })
    }

    fn column<'py>(&self, py: Python<'py>, missing: f64, of: impl Fn(&mocap::Target) -> f64) -> Bound<'py, PyArray1<f64>> {
        conv::from_vec(py, self.parts().iter().map(|part| part.as_ref().map_or(missing, &of)).collect())
    }

    fn vectors<'py>(&self, py: Python<'py>, of: impl Fn(&mocap::Target) -> mocap::Vec3) -> PyResult<Bound<'py, PyArray2<f64>>> {
        conv::rows(py, self.parts().iter().flat_map(|part| part.as_ref().map_or([f64::NAN; 3], |t| of(t).into())).collect(), 3)
    }
}

#[pymethods]
impl HandTargets {
    #[doc = doc!("HandTargets.positions")]
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        positions(py, &self.parts().map(|part| part.map(|t| t.pose)))
    }

    #[doc = doc!("HandTargets.quaternions")]
    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        quaternions(py, &self.parts().map(|part| part.map(|t| t.pose)))
    }

    #[doc = doc!("HandTargets.linear_velocities")]
    #[getter]
    fn linear_velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.vectors(py, |t| t.linear_velocity)
    }

    #[doc = doc!("HandTargets.angular_velocities")]
    #[getter]
    fn angular_velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.vectors(py, |t| t.angular_velocity)
    }

    #[doc = doc!("HandTargets.weights")]
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, 0.0, |t| t.weight)
    }

    #[doc = doc!("HandTargets.pad_radii")]
    #[getter]
    fn pad_radii<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, f64::NAN, |t| t.pad_radius)
    }

    #[doc = doc!("HandTargets.states")]
    #[getter]
    fn states(&self) -> Vec<&'static str> {
        let name = |state| match state {
            TargetState::Live => "live",
            TargetState::Held => "held",
            TargetState::Fading => "fading",
            TargetState::Lost => "lost",
        };
        self.parts().iter().map(|part| part.map_or("absent", |t| name(t.state))).collect()
    }

    #[doc = doc!("HandTargets.pad_places")]
    fn pad_places<'py>(&self, py: Python<'py>) -> PyResult<Places<'py>> {
        let (mut apexes, mut ways) = (Vec::with_capacity(3 * PARTS), Vec::with_capacity(3 * PARTS));
        for part in self.parts() {
            let (apex, way) = part.map_or(([f64::NAN; 3], [f64::NAN; 3]), |target| {
                let (apex, way) = target.pad_place();
                (apex.into(), way.into())
            });
            apexes.extend_from_slice(&apex);
            ways.extend_from_slice(&way);
        }
        Ok((conv::rows(py, apexes, 3)?, conv::rows(py, ways, 3)?))
    }

    #[doc = doc!("HandTargets.delay")]
    #[getter]
    fn delay(&self) -> f64 {
        self.targets.delay
    }

    #[doc = doc!("HandTargets.time")]
    #[getter]
    fn time(&self) -> f64 {
        self.targets.time
    }
}
