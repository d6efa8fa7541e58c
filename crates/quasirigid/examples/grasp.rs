//! The paper's grasp without Python: close, take the support away, hold.

use quasirigid::scenes::{GraspOptions, GraspScene};

fn main() -> quasirigid::Result<()> {
    let mut scene = GraspScene::new(&GraspOptions::default())?;
    let held = scene.close(3.0)?;
    println!("closed: {held} at {:.3} s, forces {:.3?} N", scene.world.time(), scene.grip.forces(&scene.world)?);
    scene.remove_support()?;
    for _ in 0..20 {
        let before = *scene.world.body(scene.object)?.pose();
        let mut last = scene.step()?;
        let mut sweeps = 0;
        for _ in 1..100 {
            last = scene.step()?;
            sweeps = sweeps.max(last.sweeps);
        }
        let now = scene.world.body(scene.object)?.pose();
        println!(
            "t {:.2} s  contacts {:3}  sweeps {:3} (most {sweeps})  residual {:.1e}  \
             moved {:.2e} m  turned {:.2e} rad  forces {:.3?} N  step {:?}",
            last.time,
            last.contacts,
            last.sweeps,
            last.residual,
            (now.translation.vector - before.translation.vector).norm(),
            before.rotation.angle_to(&now.rotation),
            scene.grip.forces(&scene.world)?,
            last.times.total(),
        );
        println!("{:?}", last.times);
    }
    Ok(())
}
