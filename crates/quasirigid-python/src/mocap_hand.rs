//! `HandFrame`, `HandDecoder`, `HandTracker`, `HandTargets` and `Calibration`: tracked hands. Rows 0 to 4 are thumb to little finger, row 5 is the palm.

use crate::conv;
use crate::errors::to_py;
use crate::mocap::{OrRaiseMocap, Packet, lock};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid_mocap as mocap;
use quasirigid_mocap::{Delay, FingerPose, PalmPose, Pose, ReferenceFrame, Side, Source, TargetState};
use std::path::PathBuf;
use std::sync::Mutex;

/// Fingers and palm.
const PARTS: usize = 6;
const PALM: usize = 5;

pub fn named_side(py: Python<'_>, name: &str) -> PyResult<Side> {
    match name {
        "left" => Ok(Side::Left),
        "right" => Ok(Side::Right),
        other => Err(to_py(py, &Error::unknown("side", "left or right", format!("{other:?}"), "one hand at a time"))),
    }
}

/// Row `k` of an array with one row for each part.
fn row<'py>(array: &Bound<'py, PyAny>, what: &str, k: usize) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let refuse = |got: String| to_py(py, &Error::shape(what, "shape (6, ...)", got, "five fingers and the palm"));
    match array.len() {
        Ok(PARTS) => array.get_item(k).map_err(|_| refuse("something without rows".into())),
        Ok(rows) => Err(refuse(format!("{rows} rows"))),
        Err(_) => Err(refuse("something without rows".into())),
    }
}

/// `(6, 3)` and `(6, 4)`; NaN where there is no pose.
fn positions<'py>(py: Python<'py>, poses: &[Option<Pose>; PARTS]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    conv::rows(py, poses.iter().flat_map(|p| p.map_or([f64::NAN; 3], |p| p.translation.vector.into())).collect(), 3)
}

fn quaternions<'py>(py: Python<'py>, poses: &[Option<Pose>; PARTS]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let wxyz = |p: Pose| [p.rotation.w, p.rotation.i, p.rotation.j, p.rotation.k];
    conv::rows(py, poses.iter().flat_map(|p| p.map_or([f64::NAN; 4], wxyz)).collect(), 4)
}

#[doc = doc!("HandFrame")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandFrame {
    pub(crate) frame: mocap::HandFrame,
}

impl HandFrame {
    /// Pose, pad radius and whether it is tracked; None for parts that the source does not have.
    fn parts(&self) -> [Option<(Pose, f64, bool)>; PARTS] {
        let f = &self.frame;
        let palm = f.palm.map(|palm| (palm.pose, 0.0, palm.tracked));
        std::array::from_fn(|k| if k == PALM { palm } else { f.fingers[k].map(|finger| (finger.tip, finger.pad_radius, finger.tracked)) })
    }

    fn poses(&self) -> [Option<Pose>; PARTS] {
        self.parts().map(|part| part.filter(|&(.., tracked)| tracked).map(|(pose, ..)| pose))
    }
}

#[pymethods]
impl HandFrame {
    #[new]
    #[allow(clippy::too_many_arguments)] // keyword arguments
    #[pyo3(signature = (side, positions, quaternions, pad_radii, tracked, *, time, arrival, source = "webxr", frame = "tracker"))]
    fn new(
        py: Python<'_>,
        side: &str,
        positions: &Bound<'_, PyAny>,
        quaternions: &Bound<'_, PyAny>,
        pad_radii: &Bound<'_, PyAny>,
        tracked: Vec<bool>,
        time: f64,
        arrival: f64,
        source: &str,
        frame: &str,
    ) -> PyResult<Self> {
        let side = named_side(py, side)?;
        let refuse =
            |what: &str, expected: &str, got: &str, hint: &str| Err(to_py(py, &Error::unknown(what, expected, format!("{got:?}"), hint)));
        let source = match source {
            "webxr" => Source::WebXr,
            "dtrack-hand" => Source::DtrackHand,
            "dtrack-bodies" => Source::DtrackBodies,
            "synthetic" => Source::Synthetic,
            other => return refuse("source", "webxr, dtrack-hand, dtrack-bodies or synthetic", other, "webxr is the default"),
        };
        let reference = match frame {
            "tracker" => ReferenceFrame::Tracker,
            "world" => ReferenceFrame::World,
            other => return refuse("frame", "tracker or world", other, "world if a calibration was applied"),
        };
        if tracked.len() != PARTS {
            return Err(to_py(py, &Error::shape("tracked", "shape (6,)", tracked.len(), "five fingers and the palm")));
        }
        // Rows that are not tracked may hold anything, NaN too; they are not looked at.
        let mut hand = mocap::HandFrame::unseen(side, time, arrival, source);
        hand.frame = reference;
        for (k, _) in tracked.iter().enumerate().filter(|&(_, &seen)| seen) {
            let turn = conv::quaternion(&row(quaternions, "quaternions", k)?, "quaternions")?;
            let pose = Pose::from_parts(conv::vec3(&row(positions, "positions", k)?, "positions")?.into(), turn);
            if k == PALM {
                hand.palm = Some(PalmPose { pose, tracked: true });
            } else {
                let radius = row(pad_radii, "pad_radii", k)?;
                let refuse = |_| to_py(py, &Error::shape("pad_radii", "numbers of shape (6,)", &radius, "give an array of real numbers"));
                let pad_radius: f64 = radius.extract().map_err(refuse)?;
                mocap::error::check_within("pad_radii", pad_radius, 0.0, 0.1, "m").or_raise(py)?;
                hand.fingers[k] = Some(FingerPose { tip: pose, pad_radius, tracked: true });
            }
        }
        for (what, x) in [("time", time), ("arrival", arrival)] {
            mocap::error::check_within(what, x, -1e12, 1e12, "s").or_raise(py)?;
        }
        Ok(Self { frame: hand })
    }

    #[getter]
    fn side(&self) -> &'static str {
        self.frame.side.name()
    }

    #[doc = doc!("HandFrame.time")]
    #[getter]
    fn time(&self) -> f64 {
        self.frame.time
    }

    #[doc = doc!("HandFrame.arrival")]
    #[getter]
    fn arrival(&self) -> f64 {
        self.frame.arrival
    }

    #[getter]
    fn source(&self) -> &'static str {
        self.frame.source.name()
    }

    #[doc = doc!("HandFrame.frame")]
    #[getter]
    fn frame(&self) -> &'static str {
        match self.frame.frame {
            ReferenceFrame::Tracker => "tracker",
            ReferenceFrame::World => "world",
        }
    }

    #[doc = doc!("HandFrame.positions")]
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        positions(py, &self.poses())
    }

    #[doc = doc!("HandFrame.quaternions")]
    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        quaternions(py, &self.poses())
    }

    #[doc = doc!("HandFrame.pad_radii")]
    #[getter]
    fn pad_radii<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        conv::from_vec(py, self.parts().iter().map(|part| part.map_or(f64::NAN, |(_, radius, _)| radius)).collect())
    }

    #[doc = doc!("HandFrame.tracked")]
    #[getter]
    fn tracked<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        conv::from_vec(py, self.poses().iter().map(Option::is_some).collect())
    }

    #[doc = doc!("HandFrame.present")]
    #[getter]
    fn present<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        conv::from_vec(py, self.parts().iter().map(Option::is_some).collect())
    }

    #[doc = doc!("HandFrame.transformed")]
    fn transformed(&self, calibration: &Calibration) -> Self {
        Self { frame: self.frame.transformed(&calibration.calibration.world_from_tracker) }
    }

    fn __repr__(&self) -> String {
        let f = &self.frame;
        let fingers: Vec<&str> = f.tracked_fingers().map(|(finger, _)| finger.name()).collect();
        format!("HandFrame({}, time={:.3}, {}, sees {})", f.side.name(), f.time, f.source.name(), fingers.join(" "))
    }
}

#[doc = doc!("HandDecoder")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandDecoder {
    decoder: Mutex<mocap::HandDecoder>,
}

#[pymethods]
impl HandDecoder {
    #[new]
    #[pyo3(signature = (side = "right", *, bodies = None))]
    fn new(py: Python<'_>, side: &str, bodies: Option<&str>) -> PyResult<Self> {
        let side = named_side(py, side)?;
        let choice = match bodies {
            None => mocap::HandChoice::Fingertracking(side),
            Some(text) if std::path::Path::new(text).extension().is_some_and(|ending| ending == "toml") => {
                let hint = "give a TOML file, or a text such as thumb=0,index=1";
                let text = std::fs::read_to_string(text).map_err(|e| mocap::Error::file(text, "a readable file", e, hint)).or_raise(py)?;
                mocap::HandChoice::Bodies(Box::new(mocap::BodyMap::from_toml(&text).or_raise(py)?))
            }
            Some(text) => mocap::HandChoice::Bodies(Box::new(mocap::BodyMap::parse(text, side).or_raise(py)?)),
        };
        Ok(Self { decoder: Mutex::new(mocap::HandDecoder::new(choice)) })
    }

    #[getter]
    fn side(&self, py: Python<'_>) -> &'static str {
        lock(py, &self.decoder).side().name()
    }

    #[doc = doc!("HandDecoder.decode")]
    pub fn decode(&self, py: Python<'_>, packet: &Packet) -> Option<HandFrame> {
        lock(py, &self.decoder).decode(&packet.packet, packet.arrival).map(|frame| HandFrame { frame })
    }
}

#[doc = doc!("Calibration")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct Calibration {
    calibration: mocap::Calibration,
}

#[pymethods]
impl Calibration {
    #[new]
    #[pyo3(signature = (position = None, quaternion = None))]
    fn new(position: Option<&Bound<'_, PyAny>>, quaternion: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let translation = position.map_or(Ok(mocap::Vec3::zeros()), |p| conv::vec3(p, "position"))?;
        let rotation = quaternion.map_or(Ok(mocap::Rot::identity()), |q| conv::quaternion(q, "quaternion"))?;
        let world_from_tracker = Pose::from_parts(translation.into(), rotation);
        Ok(Self { calibration: mocap::Calibration { world_from_tracker, residual: None } })
    }

    #[doc = doc!("Calibration.read")]
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        mocap::Calibration::read(&path).or_raise(py).map(|calibration| Self { calibration })
    }

    #[doc = doc!("Calibration.write")]
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.calibration.write(&path).or_raise(py)
    }

    #[doc = doc!("Calibration.from_three_points")]
    #[staticmethod]
    fn from_three_points(origin: &Bound<'_, PyAny>, on_x: &Bound<'_, PyAny>, in_plane: &Bound<'_, PyAny>) -> PyResult<Self> {
        let points = (conv::vec3(origin, "origin")?, conv::vec3(on_x, "on_x")?, conv::vec3(in_plane, "in_plane")?);
        mocap::Calibration::from_three_points(points.0, points.1, points.2).or_raise(origin.py()).map(|calibration| Self { calibration })
    }

    #[doc = doc!("Calibration.from_points")]
    #[staticmethod]
    fn from_points(tracker: &Bound<'_, PyAny>, world: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (from, to) = (conv::points(tracker, "tracker")?, conv::points(world, "world")?);
        mocap::Calibration::from_points(&from, &to).or_raise(tracker.py()).map(|calibration| Self { calibration })
    }

    #[doc = doc!("Calibration.position")]
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        conv::from_vec3(py, &self.calibration.world_from_tracker.translation.vector)
    }

    #[doc = doc!("Calibration.quaternion")]
    #[getter]
    fn quaternion<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        conv::from_rot(py, &self.calibration.world_from_tracker.rotation)
    }

    #[doc = doc!("Calibration.residual")]
    #[getter]
    fn residual(&self) -> Option<f64> {
        self.calibration.residual
    }
}

#[doc = doc!("HandTracker")]
#[pyclass(frozen, module = "quasirigid._quasirigid")]
pub struct HandTracker {
    tracker: Mutex<mocap::HandTracker>,
}

#[pymethods]
impl HandTracker {
    #[new]
    #[pyo3(signature = (side = "right", *, calibration = None, delay = None, hold = 0.5, fade = 0.5, catch = 0.1))]
    fn new(
        py: Python<'_>,
        side: &str,
        calibration: Option<&Calibration>,
        delay: Option<f64>,
        hold: f64,
        fade: f64,
        catch: f64,
    ) -> PyResult<Self> {
        let side = named_side(py, side)?;
        let options = mocap::TrackingOptions { delay: delay.map_or(Delay::Auto, Delay::Fixed), hold, fade, catch };
        let pose = calibration.map_or_else(Pose::identity, |c| c.calibration.world_from_tracker);
        let tracker = mocap::HandTracker::new(side, pose, options).or_raise(py)?;
        Ok(Self { tracker: Mutex::new(tracker) })
    }

    #[doc = doc!("HandTracker.push")]
    fn push(&self, py: Python<'_>, frame: &HandFrame) -> PyResult<()> {
        let pushed = lock(py, &self.tracker).push(&frame.frame);
        pushed.or_raise(py)
    }

    #[doc = doc!("HandTracker.sample")]
    fn sample(&self, py: Python<'_>, now: f64) -> PyResult<Option<HandTargets>> {
        mocap::error::check_within("now", now, -1e12, 1e12, "s").or_raise(py)?;
        let targets = lock(py, &self.tracker).sample(now);
        Ok(targets.map(|targets| HandTargets { targets }))
    }

    #[getter]
    fn side(&self, py: Python<'_>) -> &'static str {
        lock(py, &self.tracker).side().name()
    }

    #[doc = doc!("HandTracker.delay")]
    #[getter]
    fn delay(&self, py: Python<'_>) -> f64 {
        lock(py, &self.tracker).delay()
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
