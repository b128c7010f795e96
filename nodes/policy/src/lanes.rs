//! Which vector instructions run, chosen once at start, and the promise that all of them give the same bits.
//!
//! A kernel is one plain Rust function over arrays. [`on_lanes!`](crate::on_lanes) compiles it once per instruction
//! set. Every output element is its own chain of fused multiply-adds in one fixed order, so the width of a vector
//! cannot change a bit. A CPU without fused multiply-add rounds twice and forms a second class, which a recording
//! names ([`kernel_class`]).

/// The vector instructions to run on: only those that this CPU has can be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lanes(Kind);

/// Instruction sets a kernel is compiled for.
#[doc(hidden)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// x86-64 with AVX-512.
    Avx512,
    /// x86-64 with AVX2 and FMA.
    Avx2,
    /// 64-bit ARM.
    Neon,
    /// Anything, without fused multiply-add.
    Plain,
}

impl std::fmt::Display for Lanes {
    fn fmt(&self, text: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(text, "{:?}", self.0)
    }
}

impl Lanes {
    /// The widest this CPU has.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let fused =
                std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
            let wide = std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512vl")
                && std::arch::is_x86_feature_detected!("avx512bw")
                && std::arch::is_x86_feature_detected!("avx512dq");
            match (fused, wide) {
                (true, true) => Self(Kind::Avx512),
                (true, false) => Self(Kind::Avx2),
                _ => Self(Kind::Plain),
            }
        }
        #[cfg(target_arch = "aarch64")]
        {
            Self(Kind::Neon)
        }
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        {
            Self(Kind::Plain)
        }
    }

    /// All that this CPU can run, the widest first; for tests that compare them.
    #[must_use]
    pub fn available() -> Vec<Self> {
        match Self::detect().0 {
            Kind::Avx512 => vec![Self(Kind::Avx512), Self(Kind::Avx2), Self(Kind::Plain)],
            Kind::Plain => vec![Self(Kind::Plain)],
            one => vec![Self(one), Self(Kind::Plain)],
        }
    }

    /// The class of bits: `fused` or `unfused` multiply-add. Recordings of one class replay bit for bit on it.
    #[must_use]
    pub fn class(self) -> &'static str {
        if self.0 == Kind::Plain { "unfused" } else { "fused" }
    }

    /// Floats that one vector register holds.
    #[must_use]
    pub fn floats(self) -> usize {
        match self.0 {
            Kind::Avx512 => 16,
            Kind::Avx2 => 8,
            Kind::Neon | Kind::Plain => 4,
        }
    }

    /// What was chosen; for [`on_lanes!`](crate::on_lanes) only.
    #[doc(hidden)]
    #[must_use]
    pub fn kind(self) -> Kind {
        self.0
    }
}

/// The class of bits that this machine computes: `fused` or `unfused`.
#[must_use]
pub fn kernel_class() -> &'static str {
    Lanes::detect().class()
}

/// a * b + c: with one rounding where `FUSED`, else with two.
///
/// `FUSED` only inside a kernel compiled by [`on_lanes!`](crate::on_lanes): elsewhere it is a slow library call.
#[inline(always)]
#[must_use]
pub fn multiply_add<const FUSED: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FUSED { a.mul_add(b, c) } else { a * b + c }
}

/// Compiles `body::<FUSED>(arguments)`, an `#[inline(always)]` function, once per instruction set, and makes a
/// function that runs the one that its first argument, a [`Lanes`], names.
#[macro_export]
macro_rules! on_lanes {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) = $body:ident) => {
        $(#[$meta])*
        #[allow(unsafe_code, reason = "Lanes is made only where the CPU was found to have these instructions")]
        #[allow(clippy::too_many_arguments, reason = "the arguments of one kernel, forwarded")]
        $vis fn $name(lanes: $crate::Lanes, $($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,fma")]
            fn avx512($($argument: $type),*) { $body::<true>($($argument),*) }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($argument: $type),*) { $body::<true>($($argument),*) }
            match lanes.kind() {
                // SAFETY: detect() saw the instructions.
                #[cfg(target_arch = "x86_64")]
                $crate::LaneKind::Avx512 => unsafe { avx512($($argument),*) },
                // SAFETY: detect() saw the instructions.
                #[cfg(target_arch = "x86_64")]
                $crate::LaneKind::Avx2 => unsafe { avx2($($argument),*) },
                #[cfg(target_arch = "aarch64")]
                $crate::LaneKind::Neon => $body::<true>($($argument),*),
                _ => $body::<false>($($argument),*),
            }
        }
    };
}
