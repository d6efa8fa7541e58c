//! What can be read of the surface of a collider.

use crate::material::Material;
use crate::surface::Surface;
use quasirigid::math::Vec3;
use quasirigid::objects::Side;
use quasirigid::{BodyHandle, Result, World};

/// The first collider of a body, if it has one, with the body.
pub fn first(world: &World, body: BodyHandle) -> Result<Option<Side<'_>>> {
    world.colliders_of(body)?.first().map(|&collider| world.side(collider)).transpose()
}

/// The points of a surface as deformed now, world.
pub fn deformed_points(side: Side<'_>) -> Vec<Vec3> {
    let (skin, pose) = (&side.collider.skin, side.pose());
    let mut points = skin.surface.in_callers_order(&skin.deformed_points());
    points.iter_mut().for_each(|p| *p = pose.rotation * *p + pose.translation.vector);
    points
}

/// The normals of a surface as deformed now, world.
pub fn deformed_normals(side: Side<'_>) -> Vec<Vec3> {
    let (skin, turn) = (&side.collider.skin, side.pose().rotation);
    let mut normals = skin.surface.in_callers_order(&skin.deformed_normals());
    normals.iter_mut().for_each(|n| *n = turn * *n);
    normals
}

/// The displaced points of a surface: index and place in the frame of its link.
pub fn moved_points(side: Side<'_>) -> (Vec<u32>, Vec<Vec3>) {
    side.collider.skin.moved_points()
}

/// The surface at rest, frame of its link.
pub fn surface(side: Side<'_>) -> Surface {
    Surface { engine: side.collider.skin.surface.clone() }
}

/// What the surface is made of.
pub fn material(side: Side<'_>) -> Material {
    Material { engine: side.collider.skin.material.clone() }
}

/// The elastic displacement of every control point, frame of the link.
pub fn displacements(side: Side<'_>) -> Vec<Vec3> {
    side.collider.skin.displacement.clone()
}
