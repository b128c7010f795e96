//! The layout that is imported into the viewer names only what there is.
#![allow(clippy::unwrap_used, missing_docs, reason = "a test says what it expects by failing")]

use serde_json::Value;
use sidestep_msgs::DEPTH;
use sidestep_recorder::VIEW_CHANNELS;

const LAYOUT: &str = include_str!("../sidestep.foxglove-layout.json");

/// All texts of a layout, keys included.
fn texts(value: &Value, found: &mut Vec<String>) {
    match value {
        Value::String(text) => found.push(text.clone()),
        Value::Array(values) => values.iter().for_each(|value| texts(value, found)),
        Value::Object(fields) => fields.iter().for_each(|(key, value)| {
            found.push(key.clone());
            texts(value, found);
        }),
        _ => {}
    }
}

/// Whether the descriptors of a channel name a field.
fn has_field(name: &str, field: &str) -> bool {
    let channel = VIEW_CHANNELS.iter().find(|channel| channel.name == name);
    // In a descriptor a name follows the number of its bytes.
    let wanted = [&[field.len() as u8][..], field.as_bytes()].concat();
    channel.is_some_and(|channel| channel.schema().data.windows(wanted.len()).any(|bytes| bytes == wanted))
}

#[test]
fn every_topic_and_field_of_the_layout_exists() {
    let mut found = Vec::new();
    texts(&serde_json::from_str(LAYOUT).unwrap(), &mut found);
    let named: Vec<_> = found.iter().filter(|text| text.starts_with('/')).collect();
    assert!(named.len() > 25, "{named:?}");
    for text in named {
        let (name, field) = text.split_once('.').unwrap_or((text, "timestamp"));
        assert!(VIEW_CHANNELS.iter().any(|channel| channel.name == name), "{name} is no channel");
        assert!(!text.contains('.') || has_field(name, field), "{name} has no {field}");
    }
    assert!(found.iter().any(|text| text == DEPTH.row().name));
    assert!(!has_field("/view/command", "speed"), "the check can fail");
}

#[test]
fn every_panel_of_the_layout_has_its_settings_and_its_place() {
    let layout: Value = serde_json::from_str(LAYOUT).unwrap();
    let mut placed = Vec::new();
    texts(&layout["layout"], &mut placed);
    for panel in layout["configById"].as_object().unwrap().keys() {
        assert!(placed.contains(panel), "{panel}");
    }
    for panel in placed.iter().filter(|text| text.contains('!')) {
        assert!(layout["configById"].get(panel).is_some(), "{panel}");
    }
}
