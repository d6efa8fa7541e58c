//! The reader takes what the format page allows, and refuses what would be mistaken for a pose.

use quasirigid_mocap::Side;
use quasirigid_mocap::dtrack::{Packet, PacketErrorKind};

const EYE: &str = "[1.000000 0.000000 0.000000 0.000000 1.000000 0.000000 0.000000 0.000000 1.000000]";
const ZEROS: &str = "[0 0 0 0 0 0 0 0 0]";

fn parse(text: &str) -> Packet {
    Packet::parse(text.as_bytes()).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn refusal(text: &str) -> PacketErrorKind {
    match Packet::parse(text.as_bytes()) {
        Err(error) => error.kind,
        Ok(packet) => panic!("taken: {packet:?}\n{text}"),
    }
}

#[test]
fn counters_and_clocks() {
    let p = parse("fr 4294967295\r\nts 39596.024831\r\nts2 1700000000 24831 8500\r\n");
    assert_eq!((p.frame, p.time_of_day), (u32::MAX, Some(39_596.024_831)));
    assert_eq!(p.unix_time.map(|t| t.latency), Some(8500));
    assert_eq!(p.time(), Some(1_700_000_000.024_831), "ts2 goes before ts");
    assert_eq!(parse("fr 1\r\nts 12.5\r\n").time(), Some(12.5));
    assert_eq!(parse("fr 1\r\n").time(), None);
}

#[test]
fn bodies_in_new_and_old_form() {
    let p =
        parse(&format!("fr 1\r\n6dcal 5\r\n6d 2 [0 1.000][326.848 -187.216 109.503]{EYE} [4 1.000][1 2 3 -160.47 -3.69 -7.09] {EYE}\r\n"));
    let bodies = p.bodies.unwrap();
    assert_eq!(bodies.iter().map(|b| b.id).collect::<Vec<_>>(), [0, 4]);
    assert_eq!(bodies[0].placement.position, [326.848, -187.216, 109.503]);
    assert_eq!(bodies[1].placement.position, [1.0, 2.0, 3.0], "the angles of the old form are left alone");
    let p = parse(&format!("fr 1\r\n6d 1 [0 -1.000][0 0 0]{ZEROS}\r\n"));
    assert!(!p.bodies.unwrap()[0].is_tracked(), "negative quality means not tracked, and then the matrix is zero");
}

#[test]
fn matrix_is_stored_column_after_column() {
    // A quarter turn about z: the body's x axis is the room's y axis.
    let p = parse("fr 1\r\n6d 1 [0 1.000][0 0 0][0 1 0 -1 0 0 0 0 1]\r\n");
    assert_eq!(p.bodies.unwrap()[0].placement.rotation[..3], [0.0, 1.0, 0.0]);
    assert_eq!(refusal("fr 1\r\n6d 1 [0 1.000][0 0 0][0 1 0 1 0 0 0 0 1]\r\n"), PacketErrorKind::NotARotation, "a mirror image");
}

#[test]
fn every_other_line_of_the_page() {
    let cov = (0..21).map(|k| format!("{k}.5e-03")).collect::<Vec<_>>().join(" ");
    let p = parse(&format!(
        "fr 7\r\n6dcal 4\r\n6d 1 [0 1.000][0 0 0]{EYE}\r\n6dcov 1 [0 1 2 3][{cov}]\r\n6di 2 [0 0 0.000][0 0 0]{ZEROS} [1 3 0.125][1 2 \
         3]{EYE}\r\n\
         6df 1 [0 1.000 257][1 2 3 4 5 6]{EYE}\r\n6df2 2 1 [0 1.000 6 2][1 2 3]{EYE}[36 0.500 -1.000]\r\n6dmt 1 [0 -1.000 0][0 0 \
         0]{ZEROS}\r\n\
         6dmt2 1 1 [0 1.000 2 1.500][1 2 3]{EYE}[3][0.1 0.2 0.3 0.4 0.5 0.6]\r\n6dmtr 1 1 [0 1.000][1 2 3]{EYE}\r\n3d 1 [1 1.000][210.730 \
         -90.669 -108.554]\r\n\
         6dj 2 1 [0 2][0 1.000][1 2 3 4 5 6]{EYE}[1 -1.000][0 0 0 0 0 0]{ZEROS}\r\n\
         st 3 [0 3][4 2 17][1 5][0 1 0 2 3][2 2 3][0 20 18 7][1 12 12 10]\r\n"
    ));
    assert_eq!(p.standard_bodies(), Some(2), "6dcal counts the old Flystick and the old tool, which are no bodies");
    assert_eq!(p.covariances.as_ref().unwrap()[0].upper[20], 20.5e-3);
    assert_eq!(p.hybrid_bodies.as_ref().unwrap()[1].drift, 0.125);
    assert_eq!(p.old_flysticks.as_ref().unwrap()[0].buttons, 257);
    let flysticks = p.flysticks.as_ref().unwrap();
    assert_eq!((flysticks.calibrated, &flysticks.items[0].buttons[..], &flysticks.items[0].joystick[..]), (2, &[36][..], &[0.5, -1.0][..]));
    assert_eq!(p.tools.as_ref().unwrap().items[0].tip_radius, 1.5);
    assert_eq!(p.tool_references.as_ref().unwrap().items.len(), 1);
    assert_eq!(p.markers.as_ref().unwrap()[0].position, [210.730, -90.669, -108.554]);
    assert_eq!(p.people.as_ref().unwrap().items[0].joints.len(), 2);
    let status = p.status.unwrap();
    assert_eq!((status.general, status.messages), (Some([4, 2, 17]), Some([0, 1, 0, 2, 3])));
    assert_eq!(status.cameras.unwrap()[1].max_intensity, 10);
}

#[test]
fn a_hand_with_three_fingers() {
    let finger = "[ 80.1 -5.2 -12.3][1.0000 0.0000 0.0000 0.0000 -1.0000 0.0000 0.0000 0.0000 -1.0000][8.4 24.1 -12.5 25.0 -20.1 41.9]";
    let p = parse(&format!("fr 1\r\nglcal 2\r\ngl 1 [0 1.000 1 3][506.103 -122.871 99.5]{EYE}{finger}{finger}{finger}\r\n"));
    assert_eq!(p.calibrated_hands, Some(2));
    let hand = &p.hands.unwrap()[0];
    assert_eq!((hand.side, hand.fingers.len()), (Side::Right, 3));
    let f = hand.fingers[2];
    assert_eq!(
        (f.tip_radius, f.lengths, f.angles),
        (8.4, [24.1, 25.0, 41.9], [-12.5, -20.1]),
        "radius, length, angle, length, angle, length"
    );
}

#[test]
fn empty_lists_as_met_in_genuine_data() {
    let p = parse("fr 1\r\n3d 0\r\n6dmtr 0 0\r\ngl 0 \r\nglcal 0\r\n6d 0\r\n");
    assert_eq!((p.markers.map(|m| m.len()), p.hands.map(|h| h.len()), p.calibrated_hands), (Some(0), Some(0), Some(0)));
    assert_eq!(p.bodies.map(|b| b.len()), Some(0), "none seen");
    assert_eq!(parse("fr 1\r\n").bodies, None, "not sent");
}

#[test]
fn the_odd_input_that_the_official_parser_takes() {
    assert_eq!(parse("fr 1\n6d 0\n").frame, 1, "LF alone");
    assert_eq!(parse("fr 1\r6d 0").frame, 1, "CR alone, none at the end");
    assert_eq!(parse("\r\n\r\n\nfr 1\r\n\n\r6d 0\r\n\0").frame, 1, "blank lines, NUL at the end");
    assert_eq!(parse("6d 0\r\nts 1.0\r\nfr 3\r\n").frame, 3, "any order");
    let p = parse("fr 1\r\n7d 1 [what ever\r\nhello\r\n\u{fc}\u{fe}\r\n");
    assert_eq!(p.unknown_lines, 3, "unknown lines are skipped");
    let p = parse(&format!("fr 1\r\n6d 1 [0 1.000 9 9][0 0 0]{EYE}[1 1.000][0 0 0]{EYE}\r\n"));
    assert_eq!(p.bodies.unwrap().len(), 1, "surplus blocks and surplus values are left alone");
    let p = parse(&format!("fr 1\r\n6d 1   [0 1.000]  [0 0 0]  {EYE}\r\n"));
    assert_eq!(p.bodies.unwrap().len(), 1, "blanks between blocks");
}

#[test]
fn what_would_be_mistaken_for_a_pose_is_refused() {
    use PacketErrorKind::*;
    assert_eq!(refusal(""), NoFrameCounter);
    assert_eq!(refusal("garbage\r\nmore\r\n"), NoFrameCounter);
    assert_eq!(refusal("fr abc\r\n"), NotANumber);
    assert_eq!(refusal("fr -1\r\n"), OutOfRange);
    assert_eq!(refusal("fr 4294967296\r\n"), OutOfRange);
    assert_eq!(refusal("fr 99999999999999999999999999\r\n"), OutOfRange);
    assert_eq!(refusal("fr 1\r\nts -1\r\n"), OutOfRange);
    assert_eq!(refusal("fr 1\r\nts nan\r\n"), OutOfRange);
    assert_eq!(refusal("fr 1\r\n6dcal -5\r\n"), OutOfRange);
    assert_eq!(refusal(&format!("fr 1\r\n6d 1 [0 1.000][0 0 inf]{EYE}\r\n")), OutOfRange);
    assert_eq!(refusal(&format!("fr 1\r\n6d 1 [0 1.000][0 0 1e300]{EYE}\r\n")), OutOfRange);
    assert_eq!(refusal(&format!("fr 1\r\n6d 1 [0 1.000][0,0 0,0 0,0]{EYE}\r\n")), NotANumber, "decimal commas");
    assert_eq!(refusal(&format!("fr 1\r\n6d 1 [900000 1.000][0 0 0]{EYE}\r\n")), OutOfRange, "huge id");
    assert_eq!(refusal(&format!("fr 1\r\n6d 1 [-1 1.000][0 0 0]{EYE}\r\n")), OutOfRange, "negative id");
    assert_eq!(refusal("fr 1\r\n6d 1 [0 1.000][0 0 0][1 0 0 0 1 0 0 0]\r\n"), NotANumber, "8 of 9");
    assert_eq!(refusal(&format!("fr 1\r\n6d 1 [0 1.000][0 0 0]{ZEROS}\r\n")), NotARotation, "tracked, and yet a zero matrix");
    assert_eq!(refusal("fr 1\r\n6d 1 [0 1.000][0 0 0][1 0 0 0 1 0 0 0 1.1]\r\n"), NotARotation);
    assert_eq!(refusal("fr 1\r\n6d 1 [0 1.000][0 0 0][1 0 0 0 1 0 0 0\r\n"), UnclosedBlock, "cut in a block");
    assert_eq!(refusal("fr 1\r\n6d 1 [0 1.000][0 0 0[1 0 0 0 1 0 0 0 1]\r\n"), UnclosedBlock, "a bracket is missing");
    assert_eq!(refusal("fr 1\r\n6d 1 [0 1.000]\r\n"), MissingBlock);
    assert_eq!(refusal("fr 1\r\n6d 4000000000 \r\n"), OutOfRange);
    let next_line = format!("fr 1\r\n6d 2 [0 1.000][0 0 0]{EYE}\r\n6dmtr 1 1 [1 1.000][0 0 0]{EYE}\r\n");
    assert_eq!(refusal(&next_line), MissingBlock, "blocks of the next line are not taken");
    for fingers in ["6", "-1"] {
        assert_eq!(refusal(&format!("fr 1\r\ngl 1 [0 1.000 0 {fingers}][0 0 0]{EYE}\r\n")), OutOfRange);
    }
    assert_eq!(refusal("fr 1\r\n6dj 1 1 [0 201]\r\n"), OutOfRange);
    assert_eq!(refusal(&"x".repeat(70_000)), TooLong);
    let error = Packet::parse(b"fr 1\r\n6d x\r\n").unwrap_err();
    assert_eq!(error.to_string(), "line 2: a number is missing or is none");
}
