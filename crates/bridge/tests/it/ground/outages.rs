//! What operators are told of times while the link is, or will be, in an outage.

use super::*;

/// Both ways, from and to (s).
fn outage(up: Option<[f64; 2]>, down: Option<[f64; 2]>, traffic: OutageTraffic) -> LinkConfig {
    let model = |span: Option<[f64; 2]>| {
        let outages =
            span.map(|[begin, end]| Outage { begin: after(begin), end: after(end), traffic });
        Some(DirectionModel { outages: outages.into_iter().collect(), ..DirectionModel::default() })
    };
    LinkConfig { up: model(up), down: model(down), ..MOON }
}

fn told(session: &Session) -> [Option<Timestamp>; 3] {
    let record = session.ground.commands().get(&uuid(1)).unwrap();
    [record.arrives, record.earliest_ack, record.overdue_after]
}

#[test]
fn a_command_that_waits_in_an_outage_is_told_when_it_will_arrive() {
    let dark = Some([0.0, 60.0]);
    let mut session = Session::new(outage(dark, dark, OutageTraffic::Hold));
    session.go_to(1.0);
    session.send(1, 5.0);
    let times = [after(61.3), after(62.6), after(64.6)].map(Some);
    assert_eq!(told(&session), times);
    session.go_to(62.5);
    assert_eq!((session.state(1), told(&session)), (CommandState::Sent, times));
    session.go_to(68.0);
    assert_eq!(session.state(1), CommandState::Done, "60 + 1.3 + 5 + 1.3 s");
}

#[test]
fn an_outage_of_the_way_down_puts_off_the_word() {
    // The command arrives within it: its first word is said at 2.3 s and leaves at 60 s.
    let mut session = Session::new(outage(None, Some([2.0, 60.0]), OutageTraffic::Hold));
    session.go_to(1.0);
    session.send(1, 5.0);
    assert_eq!(told(&session), [after(2.3), after(61.3), after(63.3)].map(Some));
    session.go_to(61.2);
    assert_eq!(session.state(1), CommandState::Sent);
    session.go_to(61.4);
    assert_eq!(session.state(1), CommandState::Done, "all its words come at once");
}

#[test]
fn no_command_is_overdue_for_want_of_words_that_cannot_come() {
    for traffic in [OutageTraffic::Hold, OutageTraffic::Lose] {
        // It begins in the middle of the motion, and the end of the motion lies within it.
        let mut session = Session::new(MOON);
        session.go_to(1.0);
        session.send(1, 10.0);
        session.go_to(5.0);
        session
            .ground
            .set_link(session.now, "ada", outage(None, Some([6.0, 90.0]), traffic))
            .unwrap();
        session.go_to(91.2);
        assert_eq!(session.state(1), CommandState::Executing, "{traffic:?}");
        session.go_to(95.0);
        let end = match traffic {
            OutageTraffic::Hold => CommandState::Done,
            // What the rover said of its end is lost: that is for a person to find out.
            OutageTraffic::Lose => CommandState::Overdue,
        };
        assert_eq!(session.state(1), end);
    }
}

#[test]
fn a_mute_rover_is_overdue_once_words_can_come_again() {
    let mut session =
        Session::with(FakeRover::mute(), outage(None, Some([3.0, 60.0]), OutageTraffic::Lose));
    session.go_to(1.0);
    session.send(1, 5.0);
    // The first word, said at 2.3 s, comes before the outage at 3.6 s; it is due at 5.6 s, within it.
    assert_eq!(told(&session), [after(2.3), after(3.6), after(60.0 + 1.3 + 2.0)].map(Some));
    session.go_to(63.2);
    assert_eq!(session.state(1), CommandState::Sent);
    session.go_to(63.4);
    assert_eq!(session.state(1), CommandState::Overdue);
}

#[test]
fn an_outage_that_is_ended_early_or_set_later_corrects_what_was_told() {
    let dark = Some([0.0, 60.0]);
    let mut session = Session::new(outage(dark, dark, OutageTraffic::Hold));
    session.go_to(1.0);
    session.send(1, 5.0);
    session.go_to(10.0);
    session.ground.set_link(session.now, "ada", outage(None, None, OutageTraffic::Hold)).unwrap();
    assert_eq!(told(&session), [after(11.3), after(12.6), after(14.6)].map(Some));
    let later = outage(None, Some([11.0, 30.0]), OutageTraffic::Hold);
    session.ground.set_link(session.now, "ada", later).unwrap();
    assert_eq!(told(&session)[1..], [after(31.3), after(33.3)].map(Some));
    session.go_to(32.0);
    assert_eq!(session.state(1), CommandState::Done);
}

#[test]
fn an_outage_shorter_than_the_patience_moves_the_first_word_alone_and_back() {
    let mut session = Session::new(outage(None, Some([2.0, 2.5]), OutageTraffic::Hold));
    session.go_to(1.0);
    session.send(1, 5.0);
    // Nothing comes from 3.3 to 3.8 s; the first word was to come at 3.6 s, and is due at 5.6 s.
    assert_eq!(told(&session)[1..], [after(3.8), after(5.6)].map(Some));
    session.ground.set_link(session.now, "ada", outage(None, None, OutageTraffic::Hold)).unwrap();
    assert_eq!(told(&session)[1..], [after(3.6), after(5.6)].map(Some));
}

#[test]
fn what_an_outage_has_lost_is_overdue_soon_after_its_early_end() {
    let dark = Some([0.0, 600.0]);
    let mut session = Session::new(outage(dark, dark, OutageTraffic::Lose));
    session.go_to(1.0);
    session.send(1, 5.0);
    assert_eq!(told(&session)[1..], [after(601.3), after(603.3)].map(Some));
    session.go_to(20.0);
    assert_eq!(session.state(1), CommandState::Sent);
    let over = outage(None, None, OutageTraffic::Hold);
    session.ground.set_link(session.now, "ada", over).unwrap();
    session.go_to(20.1);
    assert_eq!(session.state(1), CommandState::Overdue, "a word was due at 5.6 s");
    assert_eq!(session.received.lock().unwrap().len(), 0);
}

#[test]
fn an_estop_in_an_outage_is_told_when_it_can_take_effect() {
    for traffic in [OutageTraffic::Hold, OutageTraffic::Lose] {
        let mut session = Session::new(outage(Some([0.0, 60.0]), None, traffic));
        session.go_to(5.0);
        assert_eq!(session.ground.estop(session.now, "eve").takes_effect, after(61.3));
        session.go_to(70.0);
        let first = session.received.lock().unwrap().first().cloned();
        let (at, uplink) = first.unwrap();
        assert!(matches!(uplink, Uplink::Estop { .. }) && at >= after(61.3), "{at:?}");
    }
}
