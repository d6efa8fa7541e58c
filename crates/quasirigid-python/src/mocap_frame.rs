//! `HandFrame`: a tracked hand at one time. Rows 0 to 4 are thumb to little finger, row 5 is the palm.

use crate::conv;
use crate::errors::to_py;
use crate::mocap::OrRaiseMocap;
use crate::mocap_calibration::Calibration;
use crate::mocap_parts::{PALM, PARTS, check_read, named_side, positions, quaternions, row};
use crate::value::{Value, from_cbor, to_cbor, value};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use quasirigid::Error;
use quasirigid_mocap as mocap;
use quasirigid_mocap::{FingerPose, PalmPose, Pose, ReferenceFrame, Source};

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
        #[pyo3(from_py_with = conv::text)] side: &str,
        positions: &Bound<'_, PyAny>,
        quaternions: &Bound<'_, PyAny>,
        pad_radii: &Bound<'_, PyAny>,
        tracked: Vec<bool>,
        #[pyo3(from_py_with = conv::real)] time: f64,
        #[pyo3(from_py_with = conv::real)] arrival: f64,
        #[pyo3(from_py_with = conv::text)] source: &str,
        #[pyo3(from_py_with = conv::text)] frame: &str,
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

impl Value for HandFrame {
    const NAME: &'static str = "HandFrame";

    /// Poses of parts that were not tracked mean nothing, and count for nothing.
    fn same(&self, other: &Self) -> bool {
        let head = |f: &mocap::HandFrame| (f.side, f.time, f.arrival, f.source, f.frame);
        let parts = |hand: &Self| hand.parts().map(|part| part.map(|(pose, radius, tracked)| (radius, tracked.then_some(pose))));
        head(&self.frame) == head(&other.frame) && parts(self) == parts(other)
    }

    fn digest(&self) -> Vec<f64> {
        vec![self.frame.time, self.frame.arrival]
    }

    fn write(&self) -> Result<Vec<u8>, String> {
        to_cbor(&self.frame)
    }

    fn read(bytes: &[u8]) -> Result<Self, String> {
        let hand = Self { frame: from_cbor(bytes)? };
        let known = |x: f64| (-1e12..=1e12).contains(&x);
        if !(known(hand.frame.time) && known(hand.frame.arrival)) {
            return Err("times that are none".into());
        }
        for (pose, radius, tracked) in hand.parts().into_iter().flatten() {
            if tracked {
                check_read(&pose)?;
            }
            if !(0.0..=0.1).contains(&radius) {
                return Err(format!("a pad of {radius} m"));
            }
        }
        Ok(hand)
    }
}

value!(HandFrame);
