//! Learning as a user meets it: data set, training, evaluation, closed loops; interrupted, and with what does not fit.

use crate::command_line::refused;
use crate::harness::{Alone, Folder, run, sidestep};

fn make(folder: &Folder, name: &str, samples: &str) -> String {
    let path = folder.join(name).display().to_string();
    let made = run(&["dataset", "make", &path, "--samples", samples]);
    assert!(
        made.code == 0 && made.out.contains(&format!("{samples} made-up maps")),
        "{}{}",
        made.out,
        made.err
    );
    path
}

#[test]
fn from_nothing_to_a_page_of_tables_and_a_drive() {
    // Both cores at work would make a robot that drives meanwhile late.
    let _alone = Alone::wait();
    let folder = Folder::new("learning");
    let path = |name: &str| folder.join(name).display().to_string();
    let data = make(&folder, "data", "2000");
    let (model, page, json) = (path("model.onnx"), path("page.html"), path("numbers.json"));
    let trained = run(&["train", &data, "--out", &model, "--rounds", "2", "--samples", "25600"]);
    assert!(trained.code == 0 && trained.out.contains("parameters"), "{}{}", trained.out, trained.err);
    let told = ["evaluate", &data, "--model", &model, "--samples", "200", "--html", &page, "--json", &json];
    let told = run(&told);
    assert!(told.code == 0 && told.out.contains("by world test"), "{}{}", told.out, told.err);
    assert!(std::fs::read_to_string(&page).unwrap().contains("Table I"));
    let numbers: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert!(numbers["table1"]["by_world"]["test"]["solved"]["0.1"]["skill"].as_f64().unwrap() > 0.2);
    let drawn = run(&["dataset", "info", &data, "--html", &page]);
    assert!(drawn.code == 0 && std::fs::read_to_string(&page).unwrap().contains("<figure>"), "{}", drawn.err);
    let driven = ["navigate", "--rooms", "2", "--lead", "expert", "--arbiter", "off", "--json", &json];
    let driven = run(&driven);
    assert!(driven.code == 0 && driven.out.contains("reached"), "{}{}", driven.out, driven.err);
    let tuned = run(&["tune", "--rooms", "1"]);
    assert!(tuned.code == 0 && tuned.out.contains("as shipped"), "{}{}", tuned.out, tuned.err);
}

/// Kills a training after its first checkpoint; the second call goes on and gives the file of one that was left alone.
#[test]
fn a_killed_training_loses_only_the_time_since_its_last_checkpoint() {
    // Both cores at work would make a robot that drives meanwhile late.
    let _alone = Alone::wait();
    let folder = Folder::new("killed-training");
    let path = |name: &str| folder.join(name).display().to_string();
    let data = make(&folder, "data", "300");
    let (whole, broken, checkpoint) = (path("whole.onnx"), path("broken.onnx"), path("checkpoint"));
    let train = |out: &str| {
        let words =
            ["train", &data, "--rounds", "1", "--samples", "64000", "--checkpoint", &checkpoint, "--out"];
        [&words[..], &[out]].concat().iter().map(|word| (*word).to_owned()).collect::<Vec<_>>()
    };
    let words = train(&broken);
    let mut child = sidestep(&words.iter().map(String::as_str).collect::<Vec<_>>()).spawn().unwrap();
    while !folder.join("checkpoint").exists() && child.try_wait().unwrap().is_none() {
        sidestep_bus::pause(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!folder.join("broken.onnx").exists(), "killed in time");
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    assert_eq!(run(&words).code, 0);
    std::fs::remove_file(folder.join("checkpoint")).unwrap();
    let words = train(&whole);
    assert_eq!(run(&words.iter().map(String::as_str).collect::<Vec<_>>()).code, 0);
    assert_eq!(std::fs::read(whole).unwrap(), std::fs::read(broken).unwrap());
}

#[test]
fn what_cannot_be_learned_from_is_refused_with_what_is_needed() {
    // Both cores at work would make a robot that drives meanwhile late.
    let _alone = Alone::wait();
    let folder = Folder::new("unlearnable");
    let path = |name: &str| folder.join(name).display().to_string();
    let data = make(&folder, "data", "100");
    let bytes = std::fs::read(&data).unwrap();
    std::fs::write(folder.join("cut"), &bytes[..bytes.len() - 1]).unwrap();
    let (cut, model) = (path("cut"), path("model.onnx"));
    refused(&["train", &cut, "--out", &model], 3, &["bytes for 100 records"]);
    refused(&["train", &data, "--out", &model, "--robot", "jackal"], 3, &["motion hash"]);
    refused(&["train", &path("absent"), "--out", &model], 3, &["absent"]);
    refused(&["train", &data, "--out", &model, "--rounds", "0"], 2, &["1 to 1000 rounds"]);
    refused(&["dataset", "make", &path("x"), "--samples", "0"], 2, &["needed: at least 1"]);
    refused(
        &["dataset", "make", &path("x"), "--world", "office"],
        2,
        &["needed: --from paper or --from robust"],
    );
    refused(
        &["dataset", "make", &path("x"), "--from", "paper", "--model", &cut],
        3,
        &["the policy that leads"],
    );
    refused(&["dataset", "make", &path("x"), "--from", "paper", "--world", "castle"], 3, &["castle"]);
    refused(&["dataset", "make", "/dev/full", "--samples", "4000"], 3, &["No space left"]);
    refused(&["dataset", "info", &cut], 3, &["needed"]);
    refused(&["evaluate"], 2, &["needed: at least one"]);
    refused(&["evaluate", &data, "--robot", "jackal"], 3, &["motion"]);
    refused(&["evaluate", &data, "--model", &cut], 3, &["cut"]);
    refused(&["navigate"], 2, &["nothing to drive"]);
    refused(&["navigate", "--rooms", "1", "--model", &cut], 3, &["navigate"]);
    refused(&["tune", "--rooms", "0"], 2, &["needed: at least 1"]);
    refused(&["falsify", "--evaluations", "0"], 2, &["needed: at least 1"]);
    refused(&["falsify", "--relax", "gravity"], 2, &["gravity", "needed: brake, dead_time"]);
    refused(&["falsify", "--case", "inside:00"], 2, &["needed: NAME:DIGITS"]);
    refused(&["recall", "--trials", "0"], 2, &["needed: 1 to 100000"]);
    refused(&["recall", "--robot", "jackal"], 2, &["jackal", "no depth camera, needed"]);
}

/// Twice the same call: the second finds its kilometres in the ledger and drives nothing.
#[test]
fn a_long_suite_adds_up_in_its_ledger() {
    let _alone = Alone::wait();
    let folder = Folder::new("ledger");
    let ledger = folder.join("ledger.json").display().to_string();
    let words = ["navigate", "--suite", "long", "--sight", "grid", "--km", "0.02", "--ledger", &ledger];
    let first = run(&words);
    assert!(first.code == 0 && first.out.contains("0 contacts, at most"), "{}{}", first.out, first.err);
    let kept = std::fs::read_to_string(&ledger).unwrap();
    let second = run(&words);
    assert_eq!((second.code, second.out, std::fs::read_to_string(&ledger).unwrap()), (0, first.out, kept));
    let nothing = ["navigate", "--suite", "long", "--km", "0", "--sight", "grid", "--ledger", &ledger];
    refused(&nothing, 2, &["km is 0, needed: more than 0"]);
    std::fs::write(&ledger, "[]").unwrap();
    let spoilt = run(&words);
    assert!(spoilt.code == 3 && spoilt.err.contains("needed: a ledger of `--suite long`"), "{}", spoilt.err);
    refused(&["navigate", "--suite", "long", "--rooms", "3"], 2, &["cannot be used with"]);
    refused(&["navigate", "--rooms", "3", "--km", "2"], 2, &["--suite"]);
    let absent = folder.join("absent/ledger.json").display().to_string();
    refused(&["navigate", "--suite", "long", "--ledger", &absent], 2, &["its folder does not exist"]);
}
