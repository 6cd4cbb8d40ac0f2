//! Each identity counts once.

use sim::{Motion, REMEMBERED_IDS, Stage};

use crate::{command, last_detail, on_plane, path_by, raise, run, stages};

#[test]
fn a_command_is_executed_at_most_once() {
    let mut rover = on_plane();
    let up = path_by(&rover, 1, &[raise(0.2)]);
    rover.command(command("a", up.clone()));
    rover.command(command("a", up.clone()));
    run(&mut rover, 3.0);
    let down = path_by(&rover, 1, &[-raise(0.2)]);
    rover.command(command("b", down));
    run(&mut rover, 3.0);
    // The leg is where `a` began: a late copy of it would fit, and is still refused.
    rover.command(command("a", up));
    let events = rover.take_events();
    let expected =
        [Stage::Received, Stage::Started, Stage::Received, Stage::Completed, Stage::Received];
    assert_eq!(stages(&events, "a"), expected);
    assert!(last_detail(&events, "a").starts_with("a copy of what was received before: refused"));
    run(&mut rover, 3.0);
    assert!(rover.take_events().is_empty());
}

#[test]
fn a_refused_command_is_not_carried_out_later_by_a_copy() {
    let mut rover = on_plane();
    let up = path_by(&rover, 1, &[raise(0.2)]);
    rover.estop("e");
    rover.command(command("a", up.clone()));
    rover.release("r");
    rover.command(command("a", up));
    let events = rover.take_events();
    assert_eq!(stages(&events, "a"), [Stage::Received, Stage::Rejected, Stage::Received]);
}

#[test]
fn the_memory_of_identities_is_bounded_and_forgets_the_oldest() {
    let mut rover = on_plane();
    for i in 0..=REMEMBERED_IDS {
        rover.command(command(&format!("stop {i}"), Motion::Stop));
    }
    rover.take_events();
    rover.command(command("stop 1", Motion::Stop));
    rover.command(command("stop 0", Motion::Stop));
    let events = rover.take_events();
    assert_eq!(stages(&events, "stop 1"), [Stage::Received], "the second oldest is still known");
    assert_eq!(stages(&events, "stop 0"), [Stage::Received, Stage::Completed]);
}

#[test]
fn identities_too_long_to_remember_are_refused() {
    let mut rover = on_plane();
    for id in [String::new(), "é".repeat(65)] {
        rover.command(command(&id, Motion::Stop));
        let events = rover.take_events();
        assert_eq!(events.len(), 1);
        assert_eq!(events[0].stage, Stage::Rejected);
        let text = events[0].detail.clone().unwrap();
        assert!(text.ends_with("bytes; 1 to 128 are allowed"), "{text}");
    }
    rover.command(command(&"x".repeat(128), Motion::Stop));
    assert_eq!(rover.take_events().last().unwrap().stage, Stage::Completed);
}
