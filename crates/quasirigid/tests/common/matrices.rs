//! The compliance that a body has, written down as a matrix of the user's own.

use quasirigid::collider::ComplianceModel;
use quasirigid::surface::ComplianceMatrix;
use quasirigid::{BodyHandle, World};
use std::sync::Arc;

/// The model of a body's surface, whichever it is, as a matrix over its control points.
pub fn as_matrix(world: &World, body: BodyHandle) -> ComplianceModel {
    let skin = world.skin(body).unwrap().unwrap();
    ComplianceModel::Matrix(Arc::new(ComplianceMatrix::new(&skin.compliance.assembled(&skin.surface.control)).unwrap()))
}
