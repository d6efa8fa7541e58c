//! What was found in a cloud of points and what was done about it.

use std::fmt::Write;

/// What became of the normals of a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum NormalsFound {
    /// They are as they were given, or there were none.
    #[default]
    Kept,
    /// Those of a closed surface pointed in: all were turned.
    TurnedOutward,
    /// They had no common side: this many were turned.
    Oriented(usize),
    /// They stand at more than 45 degrees to the surface at this share of the
    /// points, so that they cannot be its normals, and were left out.
    NotNormals(f64),
}

/// What was found in a cloud of points and what was done about it. The default is a clean cloud.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Findings {
    /// Points that are no part of the surface, and were left out: their positions among those given, in rising order.
    pub strays: Vec<u32>,
    /// What became of the normals that came with the cloud.
    pub normals: NormalsFound,
    /// Standard deviation of the points about the surface, as a share of their spacing, where it is noise: normals were then smoothed.
    pub noise: Option<f64>,
    /// Share of the points whose normals may look to the wrong side, where that is more than next to nothing.
    pub doubtful: Option<f64>,
    /// Areas that could only be guessed from the distance to the neighbours.
    pub guessed_areas: usize,
}

impl Findings {
    /// One sentence for each, for whoever gave the cloud.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let Some(first) = self.strays.first() {
            let count = self.strays.len();
            let mut text = format!("{count} stray point{} left out: apart from the surface, ", if count == 1 { "" } else { "s" });
            let _ = write!(text, "{} {first}", if count == 1 { "at position" } else { "the first at position" });
            notes.push(text);
        }
        match self.normals {
            NormalsFound::Kept => {}
            NormalsFound::TurnedOutward => notes.push("normals pointed inward: turned outward".into()),
            NormalsFound::Oriented(count) => {
                notes.push(format!("normals had no common side (estimated and not oriented?): oriented, {count} of them turned"));
            }
            NormalsFound::NotNormals(share) => notes.push(format!(
                "the normals given are none (colours?): {:.0} % of them are more than 45 degrees off the surface; left out",
                100.0 * share
            )),
        }
        if let Some(noise) = self.noise {
            notes.push(format!("noisy points: they scatter by {noise:.2} of their spacing about the surface; normals are smoothed"));
        }
        if let Some(share) = self.doubtful {
            notes.push(format!(
                "normals may look to the wrong side at {:.1} % of the points (walls about as thin as the points are apart, or noise): \
                 give normals, or more points",
                100.0 * share
            ));
        }
        if self.guessed_areas > 0 {
            notes.push(format!("areas of {} points are guessed from the distance to their neighbours", self.guessed_areas));
        }
        notes
    }
}
