//! Makes the take that is shipped with the Python package: `cargo run --release -p quasirigid-mocap --example make_take -- FILE.take.gz
//! [SEED]`

use quasirigid_mocap::synthetic::{PinchOptions, pinch_take};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().ok_or("usage: make_take FILE.take.gz [SEED]")?;
    let seed = arguments.next().map_or(Ok(1), |seed| seed.parse())?;
    let take = pinch_take(&PinchOptions { seed, ..PinchOptions::default() })?;
    take.write(Path::new(&file))?;
    println!("{file}: {} packets, {:.2} s, {} bytes", take.packets.len(), take.duration(), std::fs::metadata(&file)?.len());
    Ok(())
}
