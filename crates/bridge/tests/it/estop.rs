//! The E-stop's states and the two steps of its release.

use bridge::commands::{Estop, EstopError};
use wire::live::{AckStage, EstopState, RoverMode};

use crate::support::{START, after};

#[test]
fn an_estop_is_sent_confirmed_released_and_clear() {
    let mut estop = Estop::default();
    assert!(!estop.in_force());
    let stop = estop.stop(START, after(1.3));
    assert_eq!(estop.state(), EstopState::Sent);
    assert!(estop.acknowledged(START, &stop, AckStage::Received));
    assert!(!estop.acknowledged(START, &stop, AckStage::Completed), "confirmed once");
    assert_eq!(estop.state(), EstopState::Confirmed);
    let token = estop.ask_release(after(5.0)).unwrap();
    let release = estop.release(after(6.0), &token, after(7.3)).unwrap();
    assert_eq!(estop.state(), EstopState::ReleaseSent);
    assert!(estop.in_force(), "until the rover says so");
    assert!(estop.acknowledged(START, &release, AckStage::Received));
    assert_eq!(estop.state(), EstopState::Clear);
}

#[test]
fn a_release_takes_the_token_of_the_first_step_within_10_s_and_once() {
    let mut estop = Estop::default();
    assert_eq!(estop.ask_release(START), Err(EstopError::NotInForce));
    estop.stop(START, after(1.3));
    assert_eq!(estop.release(START, "guess", after(1.3)), Err(EstopError::TokenUnknown));
    let token = estop.ask_release(START).unwrap();
    assert_eq!(estop.release(START, "guess", after(1.3)), Err(EstopError::TokenUnknown));
    assert_eq!(estop.release(after(10.1), &token, after(11.4)), Err(EstopError::TokenExpired));
    assert_eq!(estop.release(after(10.1), &token, after(11.4)), Err(EstopError::TokenUnknown));
    assert_eq!(estop.state(), EstopState::Sent, "a refused release changes nothing");
    let token = estop.ask_release(after(20.0)).unwrap();
    estop.stop(after(21.0), after(22.3));
    let stale = estop.release(after(22.0), &token, after(23.3));
    assert_eq!(stale, Err(EstopError::TokenUnknown), "a new E-stop ends the release begun");
}

#[test]
fn telemetry_counts_as_a_word_only_once_the_message_has_reached_the_rover() {
    let mut estop = Estop::default();
    estop.stop(START, after(1.3));
    assert!(!estop.seen(after(1.2), RoverMode::Stopped), "stopped for another reason");
    assert!(!estop.seen(after(1.4), RoverMode::Executing), "moves on: not confirmed");
    assert!(estop.seen(after(1.4), RoverMode::Stopped));
    let token = estop.ask_release(after(5.0)).unwrap();
    estop.release(after(5.0), &token, after(6.3)).unwrap();
    assert!(!estop.seen(after(6.0), RoverMode::Idle));
    assert!(estop.seen(after(6.4), RoverMode::Idle));
    assert_eq!(estop.state(), EstopState::Clear);
}

#[test]
fn a_new_estop_on_top_of_a_release_waits_for_a_word_of_its_own() {
    let mut estop = Estop::default();
    let first = estop.stop(START, after(1.3));
    estop.acknowledged(START, &first, AckStage::Received);
    let token = estop.ask_release(after(5.0)).unwrap();
    let release = estop.release(after(5.0), &token, after(6.3)).unwrap();
    let second = estop.stop(after(5.5), after(6.8));
    assert_eq!(estop.state(), EstopState::Sent);
    for old in [&first, &release] {
        assert!(
            !estop.acknowledged(START, old, AckStage::Completed),
            "an old word confirms nothing"
        );
    }
    assert!(estop.acknowledged(START, &second, AckStage::Received));
    assert_eq!(estop.state(), EstopState::Confirmed);
}

#[test]
fn a_refused_release_leaves_the_estop_in_force() {
    let mut estop = Estop::default();
    estop.stop(START, after(1.3));
    let token = estop.ask_release(START).unwrap();
    let release = estop.release(START, &token, after(1.3)).unwrap();
    assert!(estop.acknowledged(START, &release, AckStage::Rejected));
    assert_eq!(estop.state(), EstopState::Confirmed);
}
