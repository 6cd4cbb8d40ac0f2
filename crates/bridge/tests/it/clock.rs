//! S4: the machine's clock is set in the midst of a session; order, durations, leases and times to live
//! are unaffected, and it is told once.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bridge::bus::{Bus, BusItem};
use bridge::clock::{Clock, ManualClock, SystemClock};
use bridge::ground::{Ground, run};
use bridge::recorder::Recorder;
use wire::live::{EventNotice, LinkConfig, channel};
use wire::time::Timestamp;

use crate::recorder::options;
use crate::support::{FakeRover, FaultyDisk, START, after};

/// A machine whose clock is as far off the monotonic one as it is told (ns).
fn machine() -> (SystemClock, Arc<AtomicU64>) {
    let offset = Arc::new(AtomicU64::new(START.0));
    let started = tokio::time::Instant::now();
    let read = {
        let offset = offset.clone();
        move || {
            let passed = u64::try_from(started.elapsed().as_nanos()).unwrap();
            Timestamp(offset.load(Ordering::SeqCst).saturating_add(passed))
        }
    };
    (SystemClock::reading(Box::new(read)), offset)
}

/// 2038-01-19T03:14:08Z, when 32 bits of seconds are over.
const Y2038: u64 = 2_147_483_648_000_000_000;

#[tokio::test(start_paused = true)]
async fn s4_a_clock_that_is_set_is_told_once_and_time_goes_on() {
    let (clock, wall) = machine();
    assert_eq!((clock.now(), clock.was_set_by()), (START, None));
    let mut passed_s = 0.0;
    let mut wall_before = START.0;
    let hour = 3_600_000_000_000;
    // An hour on, back, one leap second, DST, 1970, 2038, and a small correction.
    let settings =
        [START.0 + hour, START.0, START.0 - 1_000_000_000, START.0 + hour, 0, Y2038, Y2038 + 1_000];
    for setting in settings {
        tokio::time::advance(Duration::from_secs(7)).await;
        passed_s += 7.0;
        wall.store(setting, Ordering::SeqCst);
        let by_s = (setting as f64 - wall_before as f64) / 1e9;
        let told = clock.was_set_by();
        assert_eq!(told.is_some(), by_s.abs() > 0.5, "{by_s}");
        assert!((told.unwrap_or(by_s) - by_s).abs() < 1e-3, "{told:?}, {by_s}");
        assert_eq!(clock.was_set_by(), None, "told once");
        assert_eq!(clock.now(), after(passed_s), "to the nanosecond");
        wall_before = setting;
    }
}

#[test]
fn a_manual_clock_never_goes_back() {
    let clock = ManualClock::new(START);
    assert_eq!(clock.set(Timestamp(0)), START);
    assert_eq!((clock.advance(-5.0), clock.advance(5.0)), (START, after(5.0)));
}

#[tokio::test(start_paused = true)]
async fn s4_a_session_goes_on_over_settings_of_the_clock_and_logs_them() {
    let (clock, wall) = machine();
    let recorder = Recorder::start_on(Box::new(FaultyDisk::default()), options()).unwrap();
    let bus = Bus::new(100_000);
    let mut listener = bus.subscribe().1;
    let adapter = Box::new(FakeRover::new().0);
    let link = LinkConfig::delays(1.3, 1.3);
    let ground = Ground::new(START, adapter, link, recorder, bus, Box::new(|_| None)).unwrap();
    let ground = Arc::new(Mutex::new(ground));
    let driver = tokio::spawn(run(ground.clone(), Arc::new(clock)));
    let authority = ground.lock().unwrap().acquire_authority(START, "ada", false).unwrap();
    for setting in [START.0 + 3_600_000_000_000, 0, Y2038] {
        tokio::time::sleep(Duration::from_secs(5)).await;
        wall.store(setting, Ordering::SeqCst);
    }
    tokio::time::sleep(Duration::from_secs(5)).await;
    driver.abort();
    let report = ground.lock().unwrap().authority(after(20.0));
    assert_eq!(report, authority, "20 s of the lease's 30 s have passed");
    let (mut told, mut frames, mut last) = (0, 0, Timestamp(0));
    while let Some(BusItem::Message(message)) = listener.try_next() {
        assert!(message.received_time >= last, "in order");
        last = message.received_time;
        match &*message.channel {
            channel::ROVER_STATE => {
                frames += 1;
                assert_eq!(message.received_time, message.sent_time.plus_seconds(1.3));
            }
            channel::EVENT => {
                let notice: EventNotice = serde_json::from_slice(&message.json).unwrap();
                told += usize::from(notice.text.contains("clock was set by"));
            }
            _ => {}
        }
    }
    assert_eq!(told, 3);
    assert!((180..=190).contains(&frames), "10 Hz for 18.7 s: {frames}");
}
