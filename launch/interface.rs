//! The layouts of all messages for programs in other languages.

use sidestep_msgs::{Field, Header, Message, Primitive, TOPICS, Topic, TopicVisitor, visit_topics};
use std::collections::BTreeSet;
use std::convert::Infallible;
use std::fmt::Write;

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
}

impl TopicVisitor for Printer {
    type Error = Infallible;
    fn visit<M: Message>(&mut self, _topic: Topic<M>) -> Result<(), Infallible> {
        self.structure(structure_name(M::NAME), M::FIELDS, M::NAME, M::LAYOUT_HASH);
        Ok(())
    }
}

/// Everything a program in another language must know: structures, sizes, offsets, topics.
pub(crate) fn print(language: Language) -> String {
    let mut printer = Printer { language, text: String::new(), printed: BTreeSet::new() };
    let version = env!("CARGO_PKG_VERSION");
    match language {
        Language::C => {
            let head = "#pragma once\n#include <assert.h>\n#include <stddef.h>\n#include <stdint.h>";
            printer.line(format_args!(
                "// Messages of sidestep {version}, made by `sidestep interface --c`.\n{head}\n"
            ));
        }
        Language::Python => {
            let head = "import ctypes";
            printer.line(format_args!(
                "# Messages of sidestep {version}, made by `sidestep interface --python`.\n{head}\n"
            ));
        }
    }
    printer.structure("Header", Header::FIELDS, Header::NAME, Header::LAYOUT_HASH);
    let Ok(()) = visit_topics(&mut printer);
    let mark = if language == Language::C { "//" } else { "#" };
    printer.line(format_args!("{mark} service, structure, writer, rate [Hz]"));
    for row in TOPICS {
        let structure = structure_name(row.type_name);
        printer
            .line(format_args!("{mark} sidestep/{}, {structure}, {}, {}", row.name, row.writer, row.rate_hz));
    }
    printer.text
}
