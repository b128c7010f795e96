//! How much a proposer must show before it drives: frames in a row, time, doubt, stamps.

use crate::fixture::{MS, Mute, Stage, TICK};
use crate::{Config, Lead};
use sidestep_msgs::{Header, Proposal, Reason, Status, Twist, Winner};

const FORWARD: Twist = Twist::new(0.5, 0.0);

/// Driven by the other, the lead silent for long.
fn led_by_the_other(config: &Config) -> Stage {
    let mut stage = Stage::new(config, &[]);
    stage.wish = FORWARD;
    stage.ticks(60);
    stage.mute.policy = true;
    stage.ticks(30);
    assert_eq!(stage.command.winner, Winner::Expert as u32);
    stage
}

/// Ticks until the policy drives, `act` before each of them.
fn ticks_until_it_drives(stage: &mut Stage, mut act: impl FnMut(&mut Stage)) -> usize {
    let found = (0..100).find(|_| {
        act(stage);
        stage.tick().winner == Winner::Policy as u32
    });
    found.unwrap()
}

fn say(stage: &mut Stage, from: Winner, capture_ns: u64, twist: Twist) -> bool {
    let header = stage.header(Status::Ok);
    stage.arbiter.proposal(from, &Proposal { capture_ns, twist, ..Proposal::default() }, &header)
}

/// A frame at every tick: ten of them are sooner than half a second; with every other one repeated they are not in a row.
#[test]
fn ten_good_frames_in_a_row_or_half_a_second_make_a_lead_good() {
    for (lead_frames, lead_good_s, ticks) in [(10, 0.5, 9), (7, 0.5, 6), (1000, 0.5, 50), (1000, 0.2, 20)] {
        let config = Config { lead_frames, lead_good_s, ..Config::STANDARD };
        let mut stage = led_by_the_other(&config);
        let found = ticks_until_it_drives(&mut stage, |stage| {
            let now_ns = stage.now_ns;
            say(stage, Winner::Policy, now_ns, FORWARD);
        });
        assert_eq!(found, ticks, "{lead_frames} frames or {lead_good_s} s");
    }
    let mut stage = led_by_the_other(&Config::STANDARD);
    let mut last_ns = 0;
    let found = ticks_until_it_drives(&mut stage, |stage| {
        if (stage.now_ns / TICK).is_multiple_of(2) {
            last_ns = stage.now_ns;
        }
        say(stage, Winner::Policy, last_ns, FORWARD);
    });
    assert!((49..=51).contains(&found), "{found}: repeated frames are not good ones");
}

/// The lead that fails for one message begins to count anew; the frames of its earlier good life do not count.
#[test]
fn a_lead_that_fails_while_it_is_watched_is_counted_from_the_start() {
    let mut stage = led_by_the_other(&Config::STANDARD);
    stage.mute.policy = false;
    stage.ticks(24);
    assert_eq!(stage.command.winner, Winner::Expert as u32);
    let (proposal, header) = (stage.proposal(), stage.header(Status::Infeasible));
    stage.arbiter.proposal(Winner::Policy, &proposal, &header);
    stage.tick();
    let found = ticks_until_it_drives(&mut stage, |_| ());
    assert!((26..=31).contains(&found), "{found}");
}

#[test]
fn a_message_that_is_not_taken_changes_no_wish() {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = FORWARD;
    stage.ticks(60);
    stage.mute.policy = true;
    for capture_ns in [stage.now_ns - 500 * MS, stage.now_ns + 500 * MS] {
        say(&mut stage, Winner::Policy, capture_ns, Twist::new(0.1, 0.4));
        assert_eq!(stage.tick().wish, FORWARD);
    }
}

#[test]
fn doubt_of_either_kind_gives_way_at_its_limit_and_a_leading_expert_does_not_care() {
    let config = Config { doubt_limit_m_s: 0.1, doubt_limit_rad_s: 0.2, ..Config::STANDARD };
    let winner = |config: &Config, doubts: &[(f32, f32)]| {
        let mut stage = Stage::new(config, &[]);
        stage.mute.policy = true;
        for (doubt_v_m_s, doubt_w_rad_s) in doubts {
            for _ in 0..60 {
                let (proposal, header) = (stage.proposal(), stage.header(Status::Ok));
                let proposal =
                    Proposal { doubt_v_m_s: *doubt_v_m_s, doubt_w_rad_s: *doubt_w_rad_s, ..proposal };
                stage.arbiter.proposal(Winner::Policy, &proposal, &header);
                stage.tick();
            }
        }
        stage.command.winner
    };
    for (doubts, expected) in [
        (&[(0.1, 0.2)][..], Winner::Policy),
        (&[(0.101, 0.0)], Winner::Expert),
        (&[(0.0, 0.201)], Winner::Expert),
        (&[(f32::NAN, f32::NAN)], Winner::Policy),
        (&[(0.0, 0.3), (0.0, 0.17)], Winner::Expert),
        (&[(0.0, 0.3), (0.0, 0.15)], Winner::Policy),
        (&[(0.2, 0.0), (0.081, 0.0)], Winner::Expert),
        (&[(0.2, 0.0), (0.079, 0.0)], Winner::Policy),
    ] {
        assert_eq!(winner(&config, doubts), expected as u32, "{doubts:?}");
        let led = Config { lead: Lead::Expert, ..config.clone() };
        assert_eq!(winner(&led, doubts), Winner::Expert as u32, "{doubts:?}");
    }
}

#[test]
fn a_step_is_due_for_a_frame_of_the_lead_that_is_new_and_names_one() {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = FORWARD;
    stage.ticks(60);
    let (proposal, mut header) = (stage.proposal(), stage.header(Status::Ok));
    let mut offer = |from, source_frame| {
        header.source_frame = source_frame;
        let due = stage.arbiter.proposal(from, &proposal, &header);
        (due, stage.step().answers)
    };
    assert_eq!(offer(Winner::Policy, 100), (true, 1));
    assert_eq!(offer(Winner::Policy, 100), (false, 0), "the same frame");
    assert_eq!(offer(Winner::Policy, 0), (false, 0), "no frame");
    assert_eq!(offer(Winner::Policy, 7), (true, 1), "a restarted camera counts from one");
    assert_eq!(offer(Winner::Expert, 101), (false, 0), "not the lead");
    let mut led = Stage::new(&Config { lead: Lead::Expert, ..Config::STANDARD }, &[]);
    led.ticks(60);
    let (proposal, header) = (led.proposal(), Header { source_frame: 500, ..led.header(Status::Ok) });
    assert!(!led.arbiter.proposal(Winner::Policy, &proposal, &header));
    assert!(led.arbiter.proposal(Winner::Expert, &proposal, &header));
    assert_eq!((led.step().answers, led.arbiter.source_frame()), (1, 500));
}

/// Which frame a command is about: the winner's, or on a stop the map's.
#[test]
fn a_command_is_about_the_frame_of_whoever_drives() {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = FORWARD;
    stage.ticks(61);
    stage.mute = Mute { policy: true, expert: true, ..Mute::default() };
    let about = |stage: &mut Stage, from, source_frame| {
        let (proposal, mut header) = (stage.proposal(), stage.header(Status::Ok));
        header.source_frame = source_frame;
        stage.arbiter.proposal(from, &proposal, &header);
        stage.step();
        stage.step();
        stage.arbiter.source_frame()
    };
    assert_eq!(about(&mut stage, Winner::Policy, 901), 901);
    about(&mut stage, Winner::Expert, 902);
    assert_eq!(stage.command.winner, Winner::Policy as u32);
    assert_eq!(stage.arbiter.source_frame(), 901);
    stage.ticks(12);
    assert_eq!((stage.command.reason, stage.arbiter.source_frame()), (26, stage.frame));
    stage.mute.expert = false;
    stage.ticks(6);
    assert_eq!((stage.command.winner, stage.arbiter.source_frame()), (Winner::Expert as u32, stage.frame));
}

/// Both stamp their messages from the future: alive, but not refusing.
#[test]
fn proposers_with_foreign_clocks_are_stale_and_not_unfit() {
    let mut stage = Stage::new(&Config::STANDARD, &[]);
    stage.wish = FORWARD;
    stage.ticks(60);
    stage.mute = Mute { policy: true, expert: true, ..Mute::default() };
    for _ in 0..20 {
        let capture_ns = stage.now_ns + 50 * MS;
        say(&mut stage, Winner::Policy, capture_ns, FORWARD);
        say(&mut stage, Winner::Expert, capture_ns, FORWARD);
        stage.tick();
    }
    assert_eq!(stage.command.reason, Reason::StaleProposals as u32);
}
