//! The suite of the MCAP standard, and files that other programs wrote.

use crate::scan::{Extent, Scan};
use crate::{Info, Messages, PlayerError};
use mcap::records::Record;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A few files of the suite, so that something is read wherever this runs.
const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/mcap");

fn data(name: &str) -> Option<PathBuf> {
    let Ok(data) = std::env::var("SIDESTEP_DATA") else {
        println!("skipped: SIDESTEP_DATA is not set ({name})");
        return None;
    };
    Some(Path::new(&data).join(name))
}

fn texts(numbers: impl IntoIterator<Item = impl ToString>) -> Value {
    Value::Array(numbers.into_iter().map(|number| number.to_string().into()).collect())
}

fn table<K: ToString, V: ToString>(map: &BTreeMap<K, V>) -> Value {
    Value::Object(map.iter().map(|(key, value)| (key.to_string(), value.to_string().into())).collect())
}

/// What the suite's JSON says of a record: its type, and each field as text. Indices of messages are not listed there.
fn told(record: &Record) -> Option<(&'static str, Value)> {
    let said = match record {
        Record::Header(header) => ("Header", json!({"library": header.library, "profile": header.profile})),
        Record::Footer(footer) => (
            "Footer",
            json!({"summary_crc": footer.summary_crc.to_string(), "summary_start": footer.summary_start.to_string(),
                "summary_offset_start": footer.summary_offset_start.to_string()}),
        ),
        Record::Schema { header, data } => (
            "Schema",
            json!({"id": header.id.to_string(), "name": header.name, "encoding": header.encoding,
                "data": texts(data.as_ref())}),
        ),
        Record::Channel(channel) => (
            "Channel",
            json!({"id": channel.id.to_string(), "schema_id": channel.schema_id.to_string(), "topic": channel.topic,
                "message_encoding": channel.message_encoding, "metadata": table(&channel.metadata)}),
        ),
        Record::Message { header, data } => (
            "Message",
            json!({"channel_id": header.channel_id.to_string(), "sequence": header.sequence.to_string(),
                "log_time": header.log_time.to_string(), "publish_time": header.publish_time.to_string(),
                "data": texts(data.as_ref())}),
        ),
        Record::Attachment { header, data, .. } => (
            "Attachment",
            json!({"log_time": header.log_time.to_string(), "create_time": header.create_time.to_string(),
                "name": header.name, "media_type": header.media_type, "data": texts(data.as_ref())}),
        ),
        Record::Metadata(found) => {
            ("Metadata", json!({"name": found.name, "metadata": table(&found.metadata)}))
        }
        Record::DataEnd(end) => ("DataEnd", json!({"data_section_crc": end.data_section_crc.to_string()})),
        Record::MessageIndex(_) => return None,
        other => index(other)?,
    };
    Some(said)
}

fn index(record: &Record) -> Option<(&'static str, Value)> {
    let said = match record {
        Record::ChunkIndex(index) => (
            "ChunkIndex",
            json!({"chunk_length": index.chunk_length.to_string(), "compression": index.compression,
                "chunk_start_offset": index.chunk_start_offset.to_string(),
                "compressed_size": index.compressed_size.to_string(),
                "uncompressed_size": index.uncompressed_size.to_string(),
                "message_end_time": index.message_end_time.to_string(),
                "message_start_time": index.message_start_time.to_string(),
                "message_index_length": index.message_index_length.to_string(),
                "message_index_offsets": table(&index.message_index_offsets)}),
        ),
        Record::AttachmentIndex(index) => (
            "AttachmentIndex",
            json!({"offset": index.offset.to_string(), "length": index.length.to_string(), "name": index.name,
                "log_time": index.log_time.to_string(), "create_time": index.create_time.to_string(),
                "data_size": index.data_size.to_string(), "media_type": index.media_type}),
        ),
        Record::MetadataIndex(index) => (
            "MetadataIndex",
            json!({"offset": index.offset.to_string(), "length": index.length.to_string(), "name": index.name}),
        ),
        Record::SummaryOffset(offset) => (
            "SummaryOffset",
            json!({"group_opcode": offset.group_opcode.to_string(), "group_start": offset.group_start.to_string(),
                "group_length": offset.group_length.to_string()}),
        ),
        Record::Statistics(counts) => (
            "Statistics",
            json!({"attachment_count": counts.attachment_count.to_string(),
                "channel_count": counts.channel_count.to_string(), "chunk_count": counts.chunk_count.to_string(),
                "channel_message_counts": table(&counts.channel_message_counts),
                "message_count": counts.message_count.to_string(),
                "message_end_time": counts.message_end_time.to_string(),
                "message_start_time": counts.message_start_time.to_string(),
                "metadata_count": counts.metadata_count.to_string(),
                "schema_count": counts.schema_count.to_string()}),
        ),
        _ => return None,
    };
    Some(said)
}

/// Compares a file with its JSON; the number of its records.
fn check(path: &Path) -> usize {
    let text = std::fs::read_to_string(path.with_extension("json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let expected: Vec<(String, Value)> =
        expected["records"].as_array().unwrap().iter().map(field_table).collect();
    let mut scan = Scan::through(path, Extent::Whole).unwrap();
    let mut found = Vec::new();
    while let Some(record) = scan.next(|record| told(record).map(|(kind, fields)| (kind.to_owned(), fields)))
    {
        found.extend(record.unwrap());
    }
    let name = path.display();
    assert!(scan.is_complete() && scan.damage().is_none(), "{name}: {:?}", scan.damage());
    for (i, (expected, found)) in expected.iter().zip(&found).enumerate() {
        assert_eq!(expected, found, "{name}, record {i}");
    }
    assert_eq!(expected.len(), found.len(), "{name}");
    // Counts of the summary, or of the whole file where there is none, are those of the records.
    let info = Info::read(path).unwrap();
    let count = |kind: &str| found.iter().filter(|(found, _)| found == kind).count();
    assert_eq!(info.messages as usize, count("Message"), "{name}");
    assert_eq!(
        (info.attachments.len(), info.metadata.len()),
        (count("Attachment"), count("Metadata")),
        "{name}"
    );
    assert!(info.complete && info.damage.is_none(), "{name}: {info:?}");
    found.len()
}

fn field_table(record: &Value) -> (String, Value) {
    let fields = record["fields"].as_array().unwrap().iter();
    let fields: Map<_, _> =
        fields.map(|field| (field[0].as_str().unwrap().to_owned(), field[1].clone())).collect();
    (record["type"].as_str().unwrap().to_owned(), Value::Object(fields))
}

fn check_all(folder: &Path) -> usize {
    let mut files = 0;
    for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            files += check_all(&path);
        } else if path.extension().is_some_and(|end| end == "mcap") {
            assert!(check(&path) >= 3, "{}", path.display());
            files += 1;
        }
    }
    files
}

#[test]
fn every_file_of_the_standards_suite_is_read_as_its_json_says() {
    let Some(folder) = data("mcap_conformance") else { return };
    assert_eq!(check_all(&folder), 416);
}

#[test]
fn the_files_of_the_suite_that_are_shipped_are_read_as_their_json_says() {
    assert_eq!(check_all(Path::new(SHIPPED)), 6);
}

/// File, messages, channels with messages, whether it is complete; counted by the Python package mcap 1.6.
const READ: &[(&str, u64, usize, bool)] = &[
    ("mcap_lichtblick/custom-camera-model.mcap", 30, 3, true),
    ("mcap_lichtblick/example-2.mcap", 111, 1, true),
    ("mcap_lichtblick/example_logs.mcap", 1111, 2, true),
    ("mcap_rosbag2/rosbag2_cpp/test/rosbag2_cpp/bags/only_services.mcap", 12, 1, true),
    ("mcap_rosbag2/rosbag2_cpp/test/rosbag2_cpp/bags/only_topics.mcap", 7, 1, true),
    ("mcap_rosbag2/rosbag2_cpp/test/rosbag2_cpp/bags/topics_and_services.mcap", 13, 2, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/convert_a/rewriter_a_0.mcap", 150, 2, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/convert_b/rewriter_b_0.mcap", 75, 2, true),
    (
        "mcap_rosbag2/rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files/multiple_files_0.mcap",
        1324,
        1,
        true,
    ),
    (
        "mcap_rosbag2/rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files/multiple_files_1.mcap",
        1324,
        1,
        true,
    ),
    (
        "mcap_rosbag2/rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files/multiple_files_2.mcap",
        529,
        1,
        true,
    ),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/talker/talker.mcap", 20, 2, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/wbag/wbag_0.mcap", 1246, 8, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/wbag/wbag_1.mcap", 1240, 8, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/wbag/wbag_2.mcap", 1240, 8, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/wbag/wbag_3.mcap", 1240, 8, true),
    ("mcap_rosbag2/rosbag2_py/test/resources/mcap/wbag/wbag_4.mcap", 1108, 8, true),
    (
        "mcap_rosbag2/rosbag2_tests/resources/mcap/bag_with_topics_and_service_events/bag_with_topics_and_service_events.mcap",
        10,
        4,
        true,
    ),
    ("mcap_rosbag2/rosbag2_tests/resources/mcap/cdr_test/cdr_test_0.mcap", 7, 2, true),
    ("mcap_rosbag2/rosbag2_tests/resources/mcap/wrong_rmw_test/wrong_rmw_test_0.mcap", 7, 2, true),
    ("mcap_rosbag2/rosbag2_transport/test/resources/mcap/rewriter_a/rewriter_a_0.mcap", 150, 2, true),
    ("mcap_rosbag2/rosbag2_transport/test/resources/mcap/rewriter_b/rewriter_b_0.mcap", 75, 2, true),
    (
        "mcap_rosbag2/rosbag2_transport/test/resources/mcap/test_bag_for_seek/test_bag_for_seek_0.mcap",
        5,
        1,
        true,
    ),
    ("mcap_rust_crate/compressed.mcap", 826, 2, true),
    ("mcap_rust_crate/uncompressed.mcap", 826, 2, true),
    // Its messages are of a channel that it does not declare.
    ("mcap_rust_crate/zstd_chunk_with_padding.mcap", 12, 0, true),
];

#[test]
fn files_of_other_programs_are_read_with_the_counts_that_others_find_in_them() {
    let Some(folder) = data("") else { return };
    for (name, messages, channels, complete) in READ {
        let info = Info::read(&folder.join(name)).unwrap();
        let used = info.channels.iter().filter(|channel| channel.count > 0).count();
        assert_eq!(
            (info.messages, used, info.complete),
            (*messages, *channels, *complete),
            "{name}: {info:?}"
        );
        // Counted one by one it is the same: the summary, the sums and the padding agree.
        let mut scan = Scan::open(&folder.join(name)).unwrap();
        let mut counted = 0;
        while let Some(message) = scan.next(|record| matches!(record, Record::Message { .. })) {
            counted += u64::from(message.unwrap());
        }
        assert_eq!(counted, *messages, "{name}: {:?}", scan.damage());
        let refused = Messages::open(&folder.join(name)).unwrap().find_map(Result::err);
        assert!(matches!(refused, Some(PlayerError::Foreign { .. })), "{name} is described but not played");
    }
}

#[test]
fn files_that_are_no_whole_mcap_are_refused_or_described_with_the_reason() {
    let Some(folder) = data("") else { return };
    let bag = Info::read(&folder.join("mcap_lichtblick/example.bag")).unwrap_err();
    assert!(matches!(bag, PlayerError::NotMcap { .. }), "{bag}");
    let text = bag.to_string();
    for part in ["example.bag", "not an MCAP file", "ROS 1 bag", "mcap convert"] {
        assert!(text.contains(part), "{part} is missing in {text}");
    }
    let open_chunk = Info::read(&folder.join("mcap_rust_crate/chunk_not_closed.mcap")).unwrap();
    let damage = open_chunk.damage.unwrap();
    assert!(!open_chunk.complete && damage.contains("claims 18446744073709551615 bytes"), "{damage}");
    assert_eq!((open_chunk.messages, open_chunk.channels.len()), (0, 0));
}
