//! C2 on board: no command is executed on another basis than it was checked with.

use bridge::adapter::RoverAdapter;
use wire::live::{AckStage, CommandBody, Downlink, JointKnot, RoverTelemetry, Uplink};

use crate::sim_adapter::{adapter, athlete};
use crate::support::{after, uuid};

fn present() -> RoverTelemetry {
    let said = adapter().advance(after(0.0));
    said.into_iter()
        .find_map(|(_, message)| match message {
            Downlink::Telemetry(frame) => Some(frame),
            Downlink::Ack { .. } | Downlink::Image(_) => None,
        })
        .unwrap()
}

/// What the rover says last of a small motion of leg 1, with this basis.
fn outcome(change: &dyn Fn(&mut Uplink)) -> (AckStage, String) {
    let frame = present();
    let from = frame.state.joints_rad["leg1"].clone();
    let mut to = from.clone();
    to[1] -= 0.05;
    let knot = |joints_rad: Vec<f64>, time_s| JointKnot { joints_rad, time_s };
    let mut uplink = Uplink::Command {
        id: uuid(1),
        body: CommandBody::JointPath {
            leg: "leg1".into(),
            knots: vec![knot(from, 0.0), knot(to, 1.0)],
        },
        basis_joints_rad: frame.state.joints_rad,
        basis_tolerance_rad: 0.01,
        model_hash: Some(format!("{:016x}", athlete().hash())),
        epoch: Some(7),
        preconditions: Vec::new(),
    };
    change(&mut uplink);
    let mut rover = adapter();
    rover.uplink(after(0.5), uplink);
    let said = rover.advance(after(3.0));
    let mut acks = said.into_iter().filter_map(|(_, message)| match message {
        Downlink::Ack { stage, detail, .. } => Some((stage, detail.unwrap_or_default())),
        Downlink::Telemetry(_) | Downlink::Image(_) => None,
    });
    acks.next_back().unwrap()
}

#[test]
fn c2_every_field_of_the_basis_is_checked_on_board() {
    assert_eq!(outcome(&|_| {}).0, AckStage::Completed);
    for leg in 1..=6 {
        for joint in 0..6 {
            for (off, refused) in [(0.011, true), (-0.011, true), (0.009, false), (-0.009, false)] {
                let (stage, detail) = outcome(&|uplink| {
                    let Uplink::Command { basis_joints_rad, .. } = uplink else { panic!() };
                    basis_joints_rad.get_mut(&format!("leg{leg}")).unwrap()[joint] += off;
                });
                let expected = if refused { AckStage::Rejected } else { AckStage::Completed };
                assert_eq!(stage, expected, "leg{leg}, joint {joint}, {off}: {detail}");
                assert!(!refused || detail.contains("plan again"), "{detail}");
            }
        }
    }
    let (stage, detail) = outcome(&|uplink| {
        let Uplink::Command { model_hash, .. } = uplink else { panic!() };
        *model_hash = Some("0123456789abcdef".into());
    });
    assert_eq!(stage, AckStage::Rejected);
    assert!(detail.contains("0123456789abcdef"), "{detail}");
    let (stage, _) = outcome(&|uplink| {
        let Uplink::Command { basis_tolerance_rad, .. } = uplink else { panic!() };
        *basis_tolerance_rad = f64::NAN;
    });
    assert_eq!(stage, AckStage::Rejected);
}

#[test]
fn an_older_authority_is_refused_on_board() {
    let stop = |number, epoch| Uplink::Command {
        id: uuid(number),
        body: CommandBody::Stop {},
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        epoch,
        preconditions: Vec::new(),
    };
    let mut rover = adapter();
    let sent = [(1, Some(5)), (2, Some(5)), (3, Some(4)), (4, None), (5, Some(6)), (6, Some(5))];
    for (number, epoch) in sent {
        rover.uplink(after(0.1), stop(number, epoch));
    }
    let said = rover.advance(after(1.0));
    let rejected: Vec<String> = said
        .into_iter()
        .filter_map(|(_, message)| match message {
            Downlink::Ack { id, stage: AckStage::Rejected, .. } => Some(id),
            _ => None,
        })
        .collect();
    assert_eq!(rejected, [uuid(3), uuid(4), uuid(6)]);
}
