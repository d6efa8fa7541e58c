//! What is written is read back as it was, to the last digit of the wire; and what is written looks like what a controller sends.

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use quasirigid_mocap::dtrack::*;
use quasirigid_mocap::{Rot, Side};

/// A number with so many decimals.
fn decimal(most: i64, decimals: i32) -> impl Strategy<Value = f64> {
    let unit = 10f64.powi(decimals);
    (-most..=most).prop_map(move |n| n as f64 / unit)
}

fn rounded(x: f64, decimals: i32) -> f64 {
    let unit = 10f64.powi(decimals);
    (x * unit).round() / unit
}

fn rotation(decimals: i32) -> impl Strategy<Value = [f64; 9]> {
    (-3.2..3.2f64, -1.6..1.6f64, -3.2..3.2f64).prop_map(move |(a, b, c)| {
        let m = Rot::from_euler_angles(a, b, c).to_rotation_matrix();
        std::array::from_fn(|k| rounded(m.matrix().as_slice()[k], decimals))
    })
}

fn position(decimals: i32) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(decimal(900_000, decimals))
}

fn placement() -> impl Strategy<Value = Placement> {
    (position(3), rotation(6)).prop_map(|(position, rotation)| Placement { position, rotation })
}

/// Quality and placement, tracked or not.
fn maybe_placement() -> impl Strategy<Value = (f64, Placement)> {
    prop_oneof![4 => placement().prop_map(|at| (1.0, at)), 1 => Just((-1.0, Placement::UNTRACKED))]
}

fn body() -> impl Strategy<Value = Body> {
    (0..100u32, maybe_placement()).prop_map(|(id, (quality, placement))| Body { id, quality, placement })
}

fn old_device() -> impl Strategy<Value = OldDevice> {
    (0..9u32, maybe_placement(), any::<u32>()).prop_map(|(id, (quality, placement), buttons)| OldDevice { id, quality, buttons, placement })
}

fn buttons() -> impl Strategy<Value = (u32, Vec<u32>)> {
    (0..70u32).prop_flat_map(|count| (Just(count), vec(any::<u32>(), count.div_ceil(32) as usize)))
}

fn flystick() -> impl Strategy<Value = Flystick> {
    (0..9u32, maybe_placement(), buttons(), vec(decimal(1000, 3), 0..8)).prop_map(
        |(id, (quality, placement), (button_count, buttons), joystick)| Flystick {
            id,
            quality,
            placement,
            button_count,
            buttons,
            joystick,
        },
    )
}

fn tool() -> impl Strategy<Value = Tool> {
    (0..9u32, maybe_placement(), buttons(), decimal(9000, 3), prop::array::uniform6(decimal(9000, 6))).prop_map(
        |(id, (quality, placement), (button_count, buttons), radius, covariance)| Tool {
            id,
            quality,
            tip_radius: radius.abs(),
            placement,
            button_count,
            buttons,
            covariance,
        },
    )
}

fn finger() -> impl Strategy<Value = HandFinger> {
    let tip = prop_oneof![
        8 => (position(1), rotation(4)).prop_map(|(position, rotation)| Placement { position, rotation }),
        1 => Just(Placement::UNTRACKED),
    ];
    (tip, decimal(200, 1), prop::array::uniform3(decimal(900, 1)), prop::array::uniform2(decimal(900, 1)))
        .prop_map(|(tip, radius, lengths, angles)| HandFinger { tip, tip_radius: radius.abs(), lengths, angles })
}

fn hand() -> impl Strategy<Value = Hand> {
    (0..4u32, any::<bool>(), placement(), vec(finger(), 0..=5)).prop_map(|(id, right, placement, fingers)| {
        let side = if right { Side::Right } else { Side::Left };
        Hand { id, quality: 1.0, side, placement, fingers }
    })
}

fn joint() -> impl Strategy<Value = Joint> {
    (0..200u32, maybe_placement(), position(3)).prop_map(|(id, (quality, placement), angles)| Joint { id, quality, placement, angles })
}

fn listed<T: std::fmt::Debug + Clone>(item: impl Strategy<Value = T>) -> impl Strategy<Value = Option<Listed<T>>> {
    option::of((0..20u32, vec(item, 0..3)).prop_map(|(calibrated, items)| Listed { calibrated, items }))
}

fn status() -> impl Strategy<Value = Status> {
    let camera = (0..16u32, 0..500u32, 0..500u32, 0..=10u32).prop_map(|(id, reflections, used, max_intensity)| CameraStatus {
        id,
        reflections,
        used,
        max_intensity,
    });
    (option::of(any::<[u32; 3]>()), option::of(any::<[u32; 5]>()), option::of(vec(camera, 0..5)))
        .prop_map(|(general, messages, cameras)| Status { general, messages, cameras })
}

fn packet() -> impl Strategy<Value = Packet> {
    let covariance =
        (0..9u32, position(3), prop::array::uniform21(decimal(9_999_999, 9))).prop_map(|(id, reference, upper)| BodyCovariance {
            id,
            reference,
            // As many digits as are written.
            upper: upper.map(|x| format!("{x:.6e}").parse().unwrap()),
        });
    let hybrid = (0..9u32, 0..=3u32, decimal(9000, 3), placement()).prop_map(|(id, state, drift, placement)| HybridBody {
        id,
        state,
        drift,
        placement,
    });
    let marker = (1..500u32, position(3)).prop_map(|(id, position)| Marker { id, quality: 1.0, position });
    let person = (0..3u32, vec(joint(), 0..4)).prop_map(|(id, joints)| Person { id, joints });
    let unix = (0..4_000_000_000u64, 0..1_000_000u32, any::<u32>()).prop_map(|(seconds, microseconds, latency)| UnixTime {
        seconds,
        microseconds,
        latency,
    });
    let clocks = (any::<u32>(), option::of((0..86_400_000_000i64).prop_map(|us| us as f64 / 1e6)), option::of(unix), option::of(status()));
    let standard = (
        option::of(0..50u32),
        option::of(vec(body(), 0..4)),
        option::of(vec(covariance, 0..3)),
        option::of(vec(hybrid, 0..3)),
        option::of(vec(old_device(), 0..3)),
        listed(flystick()),
    );
    let rest = (
        option::of(vec(old_device(), 0..3)),
        listed(tool()),
        listed(body()),
        option::of(vec(marker, 0..6)),
        option::of(0..4u32),
        option::of(vec(hand(), 0..3)),
        listed(person),
    );
    (clocks, standard, rest).prop_map(|((frame, time_of_day, unix_time, status), standard, rest)| {
        let (calibrated_bodies, bodies, covariances, hybrid_bodies, old_flysticks, flysticks) = standard;
        let (old_tools, tools, tool_references, markers, calibrated_hands, hands, people) = rest;
        Packet {
            frame,
            time_of_day,
            unix_time,
            status,
            calibrated_bodies,
            bodies,
            covariances,
            hybrid_bodies,
            old_flysticks,
            flysticks,
            old_tools,
            tools,
            tool_references,
            markers,
            calibrated_hands,
            hands,
            people,
            unknown_lines: 0,
        }
    })
}

proptest! {
    #[test]
    fn reading_what_was_written_gives_the_same_packet(packet in packet()) {
        let bytes = packet.to_bytes();
        prop_assert!(bytes.is_ascii());
        prop_assert!(bytes.ends_with(b"\r\n"));
        let read = Packet::parse(&bytes).map_err(|e| TestCaseError::fail(format!("{e}\n{}", String::from_utf8_lossy(&bytes))))?;
        prop_assert_eq!(&read, &packet);
        prop_assert_eq!(read.to_bytes(), bytes, "and writing it again gives the same bytes");
    }

    #[test]
    fn no_bytes_at_all_make_the_reader_panic(bytes in vec(any::<u8>(), 0..400)) {
        let _ = Packet::parse(&bytes);
    }
}

#[test]
fn a_packet_looks_like_one_of_the_controller() {
    let eye = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let at = Placement { position: [326.848, -187.216, 109.503], rotation: eye };
    let tip = Placement { position: [80.06, -5.0, 12.34], rotation: eye };
    let finger = HandFinger { tip, tip_radius: 8.4, lengths: [24.1, 25.0, 41.9], angles: [-12.5, -20.1] };
    let packet = Packet {
        frame: 21_753,
        time_of_day: Some(39_596.024_831),
        calibrated_bodies: Some(1),
        bodies: Some(vec![Body { id: 0, quality: 1.0, placement: at }]),
        calibrated_hands: Some(1),
        hands: Some(vec![Hand { id: 0, quality: 1.0, side: Side::Right, placement: at, fingers: vec![finger] }]),
        markers: Some(vec![]),
        ..Packet::default()
    };
    let eye = "[1.000000 0.000000 0.000000 0.000000 1.000000 0.000000 0.000000 0.000000 1.000000]";
    let short = "[1.0000 0.0000 0.0000 0.0000 1.0000 0.0000 0.0000 0.0000 1.0000]";
    let expected = format!(
        "fr 21753\r\nts 39596.024831\r\n6dcal 1\r\n6d 1 [0 1.000][326.848 -187.216 109.503]{eye}\r\n3d 0\r\nglcal 1\r\n\
         gl 1 [0 1.000 1 1][326.848 -187.216 109.503]{eye}[80.1 -5.0 12.3]{short}[8.4 24.1 -12.5 25.0 -20.1 41.9]\r\n"
    );
    assert_eq!(String::from_utf8(packet.to_bytes()).unwrap(), expected);
    let nothing = Packet { hands: Some(vec![]), tool_references: Some(Listed { calibrated: 0, items: vec![] }), ..Packet::default() };
    assert_eq!(nothing.to_bytes(), b"fr 0\r\n6dmtr 0 0\r\ngl 0 \r\n");
}
