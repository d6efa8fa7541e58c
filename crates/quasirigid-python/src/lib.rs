//! The compiled module `quasirigid._quasirigid`: one file per class, conversions in `conv`, errors in `errors`. No physics here.
//!
//! Docstrings live in `python/quasirigid/_quasirigid.pyi`, where editors and type checkers read them; `build.rs` makes the macro `doc` of
//! them.

include!(concat!(env!("OUT_DIR"), "/docs.rs"));

mod body;
mod collider;
mod compliance_matrix;
mod contacts;
mod conv;
mod copies;
mod errors;
mod friction;
mod friction_sides;
mod grip;
mod hand;
mod hand_model;
mod handle;
mod mass_properties;
mod material;
mod mocap;
mod mocap_calibration;
mod mocap_decoder;
mod mocap_frame;
mod mocap_parts;
mod mocap_take;
mod mocap_tracker;
mod process;
mod report;
mod skin;
mod snapshot;
mod solver;
mod surface;
mod value;
mod world;
mod world_objects;

use pyo3::prelude::*;

/// The compiled engine of quasirigid.
#[pymodule]
mod _quasirigid {
    #[pymodule_export]
    use crate::body::Body;
    #[pymodule_export]
    use crate::collider::Collider;
    #[pymodule_export]
    use crate::compliance_matrix::ComplianceMatrix;
    #[pymodule_export]
    use crate::contacts::{ContactStatus, Contacts};
    #[pymodule_export]
    use crate::friction::Friction;
    #[pymodule_export]
    use crate::grip::Grip;
    #[pymodule_export]
    use crate::hand::Hand;
    #[pymodule_export]
    use crate::hand_model::HandModel;
    #[pymodule_export]
    use crate::mass_properties::MassProperties;
    #[pymodule_export]
    use crate::material::Material;
    #[pymodule_export]
    use crate::mocap::{Packet, Receiver};
    #[pymodule_export]
    use crate::mocap_calibration::Calibration;
    #[pymodule_export]
    use crate::mocap_decoder::HandDecoder;
    #[pymodule_export]
    use crate::mocap_frame::HandFrame;
    #[pymodule_export]
    use crate::mocap_take::{Replay, Take, TakeWriter};
    #[pymodule_export]
    use crate::mocap_tracker::{HandTargets, HandTracker};
    #[pymodule_export]
    use crate::report::StepReport;
    #[pymodule_export]
    use crate::snapshot::Snapshot;
    #[pymodule_export]
    use crate::solver::{_solve_contacts, ContactSolution};
    #[pymodule_export]
    use crate::surface::{_screen_cloud, Surface};
    #[pymodule_export]
    use crate::world::World;

    use pyo3::prelude::*;
    use pyo3::types::PyTuple;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("STAGES", PyTuple::new(module.py(), quasirigid::world::report::STAGES)?)
    }
}
