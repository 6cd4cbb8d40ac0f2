//! The bus: late joiners, slow listeners.

use bridge::bus::{Bus, BusItem, ChannelMessage};

use crate::support::START;

fn message(channel: &str, sequence: u64) -> ChannelMessage {
    ChannelMessage {
        channel: channel.into(),
        sequence,
        onboard_time: START,
        sent_time: START,
        received_time: START,
        json: format!("{{\"n\":{sequence}}}").into(),
    }
}

fn sequence(item: Option<BusItem>) -> u64 {
    match item {
        Some(BusItem::Message(message)) => message.sequence,
        other => panic!("a message was expected, not {other:?}"),
    }
}

#[test]
fn a_late_listener_gets_the_latest_of_each_channel_and_all_that_follows() {
    let bus = Bus::new(16);
    for sequence in 1..=3 {
        bus.publish(message("rover/state", sequence));
    }
    bus.publish(message("link/report", 1));
    let (latest, mut subscription) = bus.subscribe();
    let shown: Vec<_> = latest.iter().map(|m| (&*m.channel, m.sequence)).collect();
    assert_eq!(shown, [("link/report", 1), ("rover/state", 3)]);
    bus.publish(message("rover/state", 4));
    assert_eq!(sequence(subscription.try_next()), 4);
    assert_eq!(subscription.try_next(), None);
}

#[tokio::test]
async fn a_slow_listener_is_told_how_many_it_missed_and_goes_on() {
    let bus = Bus::new(4);
    let (_, mut subscription) = bus.subscribe();
    for sequence in 1..=10 {
        bus.publish(message("rover/state", sequence));
    }
    assert_eq!(subscription.next().await, Some(BusItem::Gap(6)));
    for expected in 7..=10 {
        assert_eq!(sequence(subscription.next().await), expected);
    }
    drop(bus);
    assert_eq!(subscription.next().await, None);
}
