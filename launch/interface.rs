//! What a program in another language must know: layouts, codes, topics, and how to join the run that started it.

use sidestep_msgs::{
    AGE_NEVER, AGE_OLDER, ClockMode, Code, DEPTH_PIXELS, EstopAction, Field, GoalKind, Header, INPUTS_MAX,
    LOCAL_SIDE, Message, NO_CELL, NodeState, PATH_POINTS, Primitive, RANGES_MAX, Reason, SAFETY_SIDE,
    SCAN_BEAMS, STAGES, Stage, Status, TOPICS, TOPICS_MAX, TargetState, Topic, TopicVisitor, VALID_FOR_NS,
    Winner, visit_topics,
};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::fmt::{Debug, Write};

/// The version of the transport that a program in another language must use.
const ICEORYX2: &str = "0.10.0";

/// Numbers that the layouts do not tell.
const NUMBERS: &[(&str, u64)] = &[
    ("NO_CELL", NO_CELL as u64),
    ("VALID_FOR_NS", VALID_FOR_NS),
    ("INPUTS_MAX", INPUTS_MAX as u64),
    ("STAGES", STAGES as u64),
    ("TOPICS_MAX", TOPICS_MAX as u64),
    ("DEPTH_PIXELS", DEPTH_PIXELS as u64),
    ("SCAN_BEAMS", SCAN_BEAMS as u64),
    ("RANGES_MAX", RANGES_MAX as u64),
    ("PATH_POINTS", PATH_POINTS as u64),
    ("LOCAL_SIDE", LOCAL_SIDE as u64),
    ("SAFETY_SIDE", SAFETY_SIDE as u64),
    ("AGE_OLDER", AGE_OLDER as u64),
    ("AGE_NEVER", AGE_NEVER as u64),
];

/// The other language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Language {
    /// A C header with size and offset assertions.
    C,
    /// A Python module of ctypes structures.
    Python,
}

struct Printer {
    language: Language,
    text: String,
    printed: BTreeSet<&'static str>,
}

fn c_type(field: &Field) -> &'static str {
    match field.primitive {
        Primitive::U8 => "uint8_t",
        Primitive::U16 => "uint16_t",
        Primitive::U32 => "uint32_t",
        Primitive::U64 => "uint64_t",
        Primitive::I32 => "int32_t",
        Primitive::F32 => "float",
        Primitive::F64 => "double",
        Primitive::Record => field.record_name,
    }
}

fn python_type(field: &Field) -> &'static str {
    match field.primitive {
        Primitive::U8 => "ctypes.c_uint8",
        Primitive::U16 => "ctypes.c_uint16",
        Primitive::U32 => "ctypes.c_uint32",
        Primitive::U64 => "ctypes.c_uint64",
        Primitive::I32 => "ctypes.c_int32",
        Primitive::F32 => "ctypes.c_float",
        Primitive::F64 => "ctypes.c_double",
        Primitive::Record => field.record_name,
    }
}

/// `sidestep/LocalMap/1` is the structure `LocalMap`.
fn structure_name(type_name: &'static str) -> &'static str {
    type_name.split('/').nth(1).unwrap_or(type_name)
}

/// `StaleMap` is the constant `STALE_MAP`.
fn constant_name(name: &str) -> String {
    let mut constant = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !constant.is_empty() {
            constant.push('_');
        }
        constant.push(letter.to_ascii_uppercase());
    }
    constant
}

impl Printer {
    fn line(&mut self, line: std::fmt::Arguments) {
        // Writing to a String cannot fail.
        let _ = self.text.write_fmt(line);
        self.text.push('\n');
    }

    fn structure(&mut self, name: &'static str, fields: &'static [Field], type_name: &str, hash: u64) {
        for field in fields.iter().filter(|field| field.primitive == Primitive::Record) {
            self.structure(field.record_name, field.record, "", 0);
        }
        if !self.printed.insert(name) {
            return;
        }
        let size = fields.last().map_or(0, |last| last.offset + last.size);
        match self.language {
            Language::C => self.c_structure(name, fields, size),
            Language::Python => self.python_structure(name, fields, type_name),
        }
        if !type_name.is_empty() {
            let mark = if self.language == Language::C { "//" } else { "#" };
            self.line(format_args!("{mark} {type_name}: {size} bytes, layout {hash:016x}\n"));
        }
    }

    fn c_structure(&mut self, name: &str, fields: &[Field], size: usize) {
        self.line(format_args!("typedef struct {name} {{"));
        for field in fields {
            let array = if field.count > 1 { format!("[{}]", field.count) } else { String::new() };
            self.line(format_args!("    {} {}{array};", c_type(field), field.name));
        }
        self.line(format_args!("}} {name};"));
        self.line(format_args!("static_assert(sizeof({name}) == {size}, \"{name}: size\");"));
        for field in fields {
            let place = format!("offsetof({name}, {}) == {}", field.name, field.offset);
            self.line(format_args!("static_assert({place}, \"{name}.{}: offset\");", field.name));
        }
    }

    fn python_structure(&mut self, name: &str, fields: &[Field], type_name: &str) {
        self.line(format_args!("class {name}(ctypes.Structure):"));
        self.line(format_args!("    _fields_ = ["));
        for field in fields {
            let array = if field.count > 1 { format!(" * {}", field.count) } else { String::new() };
            self.line(format_args!("        (\"{}\", {}{array}),", field.name, python_type(field)));
        }
        self.line(format_args!("    ]"));
        if !type_name.is_empty() {
            self.line(format_args!(
                "    @staticmethod\n    def type_name() -> str:\n        return \"{type_name}\""
            ));
        }
        self.line(format_args!(""));
    }

    /// Named values of a `u32` in a message, and their words.
    fn codes<C: Code + Debug>(&mut self, name: &str) {
        let prefix = format!("SIDESTEP_{}", constant_name(name));
        match self.language {
            Language::C => self.line(format_args!("enum {{")),
            Language::Python => self.line(format_args!("class {name}(Code):")),
        }
        for value in C::ALL {
            let (constant, code) = (constant_name(&format!("{value:?}")), value.code());
            match self.language {
                Language::C => {
                    self.line(format_args!("    {prefix}_{constant} = {code}, // {}", value.label()))
                }
                Language::Python => self.line(format_args!("    {constant} = {code}, \"{}\"", value.label())),
            }
        }
        if self.language == Language::C {
            let function = prefix.to_ascii_lowercase();
            self.line(format_args!("}};\nstatic inline const char *{function}_label(uint32_t code)\n{{"));
            self.line(format_args!("    switch (code) {{"));
            for value in C::ALL {
                self.line(format_args!("    case {}: return \"{}\";", value.code(), value.label()));
            }
            self.line(format_args!("    default: return \"unknown\";\n    }}\n}}"));
        }
        self.line(format_args!(""));
    }

    fn all_codes(&mut self) {
        if self.language == Language::Python {
            self.line(format_args!(
                "class Code(enum.IntEnum):\n    def __new__(cls, code, label):\n        value = int.__new__(cls, code)\n        \
                 value._value_, value.label = code, label\n        return value\n"
            ));
        }
        self.codes::<ClockMode>("ClockMode");
        self.codes::<Status>("Status");
        self.codes::<Stage>("Stage");
        self.codes::<NodeState>("NodeState");
        self.codes::<Winner>("Winner");
        self.codes::<Reason>("Reason");
        self.codes::<GoalKind>("GoalKind");
        self.codes::<TargetState>("TargetState");
        self.codes::<EstopAction>("EstopAction");
    }

    fn c_topics(&mut self) {
        self.line(format_args!(
            "typedef struct sidestep_topic {{\n    const char *service;   // of the messages, and of the event that wakes readers\n    \
             const char *type_name; // payload type\n    const char *layout;    // service attribute \"layout\"\n    \
             const char *writer;\n    size_t size;    // bytes of a message\n    size_t buffer;  // messages kept per reader of all\n    \
             size_t history; // messages a late reader gets\n    float rate_hz;  // nominal; 0 = on demand\n}} sidestep_topic;\nenum {{"
        ));
        for row in TOPICS {
            let constant = row.name.replace('/', "_").to_ascii_uppercase();
            self.line(format_args!("    SIDESTEP_TOPIC_{constant} = {},", row.index));
        }
        self.line(format_args!(
            "    SIDESTEP_TOPICS = {}\n}};\nstatic const sidestep_topic sidestep_topics[SIDESTEP_TOPICS] = {{",
            TOPICS.len()
        ));
        for row in TOPICS {
            self.line(format_args!(
                "    {{\"sidestep/{}\", \"{}\", \"{:016x}\", \"{}\", {}, {}, {}, {:.1}f}},",
                row.name,
                row.type_name,
                row.layout_hash,
                row.writer,
                row.size,
                row.buffer,
                row.history,
                row.rate_hz
            ));
        }
        self.line(format_args!("}};\n"));
    }

    fn python_topics(&mut self) {
        self.line(format_args!(
            "Row = collections.namedtuple(\"Row\", \"index name structure layout writer rate_hz buffer history readers\")"
        ));
        self.line(format_args!(
            "# The service of a topic, and the event that wakes its readers, is named \"sidestep/\" + name."
        ));
        self.line(format_args!("TOPICS = {{row.name: row for row in ["));
        for row in TOPICS {
            self.line(format_args!(
                "    Row({}, \"{}\", {}, \"{:016x}\", \"{}\", {:.1}, {}, {}, {}),",
                row.index,
                row.name,
                structure_name(row.type_name),
                row.layout_hash,
                row.writer,
                row.rate_hz,
                row.buffer,
                row.history,
                row.readers
            ));
        }
        self.line(format_args!("]}}\n"));
    }
}

impl TopicVisitor for Printer {
    type Error = Infallible;
    fn visit<M: Message>(&mut self, _topic: Topic<M>) -> Result<(), Infallible> {
        self.structure(structure_name(M::NAME), M::FIELDS, M::NAME, M::LAYOUT_HASH);
        Ok(())
    }
}

/// Everything a program in another language must know: structures, sizes, offsets, codes, topics, and how to join.
pub(crate) fn print(language: Language) -> String {
    let mut printer = Printer { language, text: String::new(), printed: BTreeSet::new() };
    let version = env!("CARGO_PKG_VERSION");
    match language {
        Language::C => {
            let includes = ["assert", "stddef", "stdint", "stdlib", "string", "time"];
            let includes: String = includes.iter().map(|name| format!("#include <{name}.h>\n")).collect();
            printer.line(format_args!(
                "// Messages of sidestep {version}, made by `sidestep interface --c`. C11; SI units, radians.\n\
                 #ifndef SIDESTEP_INTERFACE\n#define SIDESTEP_INTERFACE\n{includes}\n\
                 #define SIDESTEP_ICEORYX2 \"{ICEORYX2}\"\n#define SIDESTEP_ALIGNMENT 8\n\
                 #define SIDESTEP_HEADER_NAME \"{}\"",
                Header::NAME
            ));
            NUMBERS
                .iter()
                .for_each(|(name, value)| printer.line(format_args!("#define SIDESTEP_{name} {value}u")));
        }
        Language::Python => {
            printer.line(format_args!(
                "# Messages of sidestep {version}, made by `sidestep interface --python`. SI units, radians.\n\
                 import atexit\nimport collections\nimport ctypes\nimport enum\nimport os\nimport signal\nimport sys\nimport time\n\n\
                 ICEORYX2 = \"{ICEORYX2}\""
            ));
            NUMBERS.iter().for_each(|(name, value)| printer.line(format_args!("{name} = {value}")));
        }
    }
    printer.line(format_args!(""));
    printer.all_codes();
    printer.structure("Header", Header::FIELDS, Header::NAME, Header::LAYOUT_HASH);
    let Ok(()) = visit_topics(&mut printer);
    match language {
        Language::C => {
            printer.c_topics();
            printer.text.push_str(include_str!("interface/link.h"));
            printer.line(format_args!("\n#endif"));
        }
        Language::Python => {
            printer.python_topics();
            printer.text.push_str(include_str!("interface/link.py"));
        }
    }
    printer.text
}
