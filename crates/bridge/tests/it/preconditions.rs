//! What a command waits for: compared, aged, asked on board when it begins, each command once.

use bridge::adapter::RoverAdapter;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use wire::live::{
    AckStage, CommandBody, Comparison, Downlink, OperatingMode, Precondition, SequenceStep, Uplink,
};
use wire::precondition::met;
use wire::time::Timestamp;

use crate::sim_adapter::adapter;
use crate::support::{after, cases};

fn wants(channel: &str, field: &str, op: Comparison, value: Value) -> Precondition {
    let (channel, field) = (channel.into(), field.into());
    Precondition { channel, field, op, value, max_age_s: 5.0, observed: None }
}

fn command(id: &str, body: CommandBody, preconditions: Vec<Precondition>) -> Uplink {
    Uplink::Command {
        id: id.into(),
        body,
        basis_joints_rad: Default::default(),
        basis_tolerance_rad: 0.0,
        model_hash: None,
        epoch: None,
        preconditions,
    }
}

fn mode(mode: OperatingMode) -> CommandBody {
    CommandBody::Mode { mode }
}

fn words(said: &[(Timestamp, Downlink)], of: &str) -> Vec<(AckStage, String)> {
    said.iter()
        .filter_map(|(_, said)| match said {
            Downlink::Ack { id, stage, detail } if id == of => {
                Some((*stage, detail.clone().unwrap_or_default()))
            }
            _ => None,
        })
        .collect()
}

#[test]
fn fields_compare_by_kind_and_order_and_age() {
    let message = json!({"a": {"b": [1.5, "x", true]}, "n": null});
    let now = after(10.0);
    let code = |field: &str, op, value: Value, age_s: f64| {
        let wanted = wants("rover/state", field, op, value);
        met(&wanted, Some(&message), after(10.0 - age_s), now).map_err(|unmet| unmet.code())
    };
    use Comparison::{Eq, Ge, Gt, Le, Lt, Ne};
    for (op, value, holds) in [
        (Eq, 1.5, true),
        (Eq, 1.4, false),
        (Ne, 1.4, true),
        (Ne, 1.5, false),
        (Lt, 1.6, true),
        (Lt, 1.5, false),
        (Le, 1.5, true),
        (Le, 1.4, false),
        (Gt, 1.4, true),
        (Gt, 1.5, false),
        (Ge, 1.5, true),
        (Ge, 1.6, false),
    ] {
        let expected = if holds { Ok(()) } else { Err("precondition_failed") };
        assert_eq!(code("a.b.0", op, json!(value), 0.0), expected, "{op:?} {value}");
    }
    assert_eq!(code("a.b.1", Eq, json!("x"), 0.0), Ok(()));
    assert_eq!(code("a.b.2", Ne, json!(false), 0.0), Ok(()));
    for (field, op, value) in [
        ("a.b.1", Lt, json!("y")),
        ("a.b.2", Eq, json!(1)),
        ("a.b.3", Eq, json!(1)),
        ("a.c", Eq, json!(1)),
        ("n", Eq, json!(1)),
        ("a..b", Eq, json!(1)),
        ("", Eq, json!(1)),
    ] {
        assert_eq!(code(field, op, value, 0.0), Err("precondition_unknown"), "{field}");
    }
    assert_eq!(code("a.b.0", Eq, json!(1.5), 5.0), Ok(()));
    assert_eq!(code("a.b.0", Eq, json!(1.5), 5.1), Err("precondition_stale"));
    let none = wants("rover/state", "a", Eq, json!(1));
    assert_eq!(met(&none, None, now, now).unwrap_err().code(), "precondition_unknown");
}

#[test]
fn what_was_refused_on_board_is_not_carried_out_by_a_copy() {
    let mut adapter = adapter();
    let braked = wants("rover/state", "operation.wheels.leg1.brake", Comparison::Eq, json!(false));
    let safe = command("safe", mode(OperatingMode::Safe), vec![braked]);
    adapter.uplink(after(1.0), safe.clone());
    adapter.uplink(after(2.0), command("drive", mode(OperatingMode::Driving), Vec::new()));
    let release = CommandBody::WheelBrake { legs: Vec::new(), on: false };
    adapter.uplink(after(4.0), command("off", release, Vec::new()));
    // Now it would hold.
    adapter.uplink(after(6.0), safe);
    let said = adapter.advance(after(9.0));
    let told = words(&said, "safe");
    let stages: Vec<AckStage> = told.iter().map(|(stage, _)| *stage).collect();
    assert_eq!(stages, [AckStage::Received, AckStage::Rejected, AckStage::Received]);
    assert!(
        told[1].1.contains("rover/state operation.wheels.leg1.brake is true, not equal to false"),
        "{}",
        told[1].1
    );
}

#[test]
fn what_only_the_ground_knows_is_too_old_on_board_when_its_message_is() {
    let mut adapter = adapter();
    let seen = |at_s: f64| {
        let mut wanted = wants("rover/stability", "torque_ratio", Comparison::Lt, json!(1.0));
        wanted.observed = Some(after(at_s));
        wanted
    };
    let body = || mode(OperatingMode::Driving);
    adapter.uplink(after(10.0), command("young", body(), vec![seen(5.1)]));
    adapter.uplink(after(12.0), command("old", body(), vec![seen(6.9)]));
    let mut never = seen(0.0);
    never.observed = None;
    adapter.uplink(after(14.0), command("never", body(), vec![never]));
    let said = adapter.advance(after(16.0));
    let last = |id: &str| words(&said, id).pop().unwrap();
    assert_eq!(last("young").0, AckStage::Completed);
    assert_eq!(last("old").0, AckStage::Rejected);
    assert!(last("old").1.contains("torque_ratio is stale: it is 5.1 s old"), "{}", last("old").1);
    assert_eq!(last("never").0, AckStage::Rejected);
}

#[test]
fn a_command_that_stops_takes_no_preconditions() {
    let mut adapter = adapter();
    let wanted = wants("rover/state", "mode", Comparison::Eq, json!("idle"));
    adapter.uplink(after(1.0), command("hold", CommandBody::Hold {}, vec![wanted]));
    let said = adapter.advance(after(2.0));
    assert_eq!(words(&said, "hold").pop().unwrap().0, AckStage::Rejected);
}

/// C1 for the new kinds: random sequences and modes, with copies that come late and in any order. Each
/// identity begins at most once, none begins while its precondition does not hold, and what comes
/// after the first step that fails is not begun.
#[test]
fn c1_no_command_begins_twice_and_none_on_a_stale_basis() {
    for seed in 0..cases(400) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut adapter = adapter();
        let mut sent: Vec<Uplink> = Vec::new();
        let mut now_s = 0.0;
        let mut present = OperatingMode::Ready;
        let mut begun = std::collections::BTreeMap::new();
        let name = |m: OperatingMode| serde_json::to_value(m).unwrap();
        let modes = [OperatingMode::Safe, OperatingMode::Ready, OperatingMode::Driving];
        for i in 0..12 {
            now_s += 3.0;
            if !sent.is_empty() && rng.random_bool(0.4) {
                let copy = sent[rng.random_range(0..sent.len())].clone();
                adapter.uplink(after(now_s), copy);
            } else {
                // A sequence of two modes; each waits for the mode before.
                let [first, second, wait_1, wait_2] = [0; 4].map(|_| modes[rng.random_range(0..3)]);
                let waits =
                    |m| vec![wants("rover/state", "operation.mode", Comparison::Eq, name(m))];
                let step = |m, preconditions| SequenceStep { body: mode(m), preconditions };
                let steps = vec![step(first, Vec::new()), step(second, waits(wait_2))];
                let id = format!("c{i}");
                let body = CommandBody::Sequence { steps };
                let uplink = command(&id, body, waits(wait_1));
                adapter.uplink(after(now_s), uplink.clone());
                sent.push(uplink);
                // The model: three lines.
                if wait_1 == present {
                    let reaches = wait_2 == first;
                    present = if reaches { second } else { first };
                    begun.insert(id, if reaches { AckStage::Completed } else { AckStage::Failed });
                } else {
                    begun.insert(id, AckStage::Rejected);
                }
            }
            let said = adapter.advance(after(now_s + 2.5));
            let frame = said.iter().rev().find_map(|(_, d)| match d {
                Downlink::Telemetry(frame) => frame.operation.as_ref().map(|o| o.mode),
                Downlink::Ack { .. } | Downlink::Image(_) => None,
            });
            assert_eq!(frame, Some(present), "seed {seed}, message {i}");
            for (_, said) in said {
                let Downlink::Ack { id, stage, .. } = said else { continue };
                let ends =
                    matches!(stage, AckStage::Completed | AckStage::Failed | AckStage::Rejected);
                if ends {
                    assert_eq!(begun.remove(&id), Some(stage), "seed {seed}: {id} ended twice");
                }
            }
        }
        assert!(begun.is_empty(), "seed {seed}: {begun:?} never ended");
    }
}
