//! Whether a surface of so many points fits in the memory of the machine: asked before the first array is made.

use crate::error::{Error, Result};
use std::sync::LazyLock;
use sysinfo::{MemoryRefreshKind, System};

/// Bytes that a surface takes for each of its points while it is built, at the
/// highest: measured with 1.2 million points, 397, and a little more.
pub const BYTES_PER_POINT: u64 = 450;
/// Fewer points fit wherever the rest of the program does.
const SURELY_FITS: usize = 1_000_000;

/// Refuses a number of points whose surface the free memory of the machine, or of the container that this runs in, cannot hold.
///
/// # Errors
/// [`Error::InvalidValue`] with the bytes that would be needed and those that are free.
pub fn check_memory(points: usize) -> Result<()> {
    if points <= SURELY_FITS {
        return Ok(());
    }
    let needed = (points as u64).saturating_mul(BYTES_PER_POINT);
    match free_memory() {
        Some(free) if needed > free => Err(Error::value(
            "number of points",
            format!("a surface that fits in memory, of which {} are free", gigabytes(free)),
            format!("{points}, which take {}", gigabytes(needed)),
            "a few thousand points make a surface: ask for fewer, or thin the cloud out",
        )),
        _ => Ok(()),
    }
}

/// Refuses what takes more bytes than the memory of the machine, or of the container that this runs in, has free.
///
/// # Errors
/// [`Error::InvalidValue`] with both numbers.
pub(crate) fn check_bytes(what: &str, needed: u64) -> Result<()> {
    if needed <= SURELY_FITS as u64 * BYTES_PER_POINT {
        return Ok(());
    }
    match free_memory() {
        Some(free) if needed > free => {
            let expected = format!("no more than the free memory, {}", gigabytes(free));
            Err(Error::value(what, expected, gigabytes(needed), "free some memory, or make it of narrower layers"))
        }
        _ => Ok(()),
    }
}

/// Bytes that can be had, or `None` on a system that does not say.
fn free_memory() -> Option<u64> {
    static SUPPORTED: LazyLock<bool> = LazyLock::new(|| sysinfo::IS_SUPPORTED_SYSTEM);
    if !*SUPPORTED {
        return None;
    }
    let mut system = System::new();
    system.refresh_memory_specifics(MemoryRefreshKind::nothing().with_ram());
    let of_container = system.cgroup_limits().map_or(u64::MAX, |limits| limits.free_memory);
    Some(system.available_memory().min(of_container)).filter(|free| *free > 0)
}

fn gigabytes(bytes: u64) -> String {
    format!("{:.1} GB ({bytes} bytes)", bytes as f64 / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::shapes::sample_sphere;

    #[test]
    fn more_points_than_memory_holds_are_refused_with_the_bytes_before_any_is_made() {
        assert!(check_memory(1000).is_ok());
        let text = sample_sphere(0.03, 4_000_000_000).unwrap_err().to_string();
        assert!(text.contains("1800000000000 bytes") && text.contains("are free"), "{text}");
    }
}
