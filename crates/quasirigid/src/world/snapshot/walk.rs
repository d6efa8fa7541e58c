//! A serializer that stores nothing: it shows every number of what it is given to a visitor, in order. What is
//! hashed, compared or checked of a state is then always all of it, whatever fields the types have.

use crate::math::Real;
use serde::ser::{
    Impossible, Serialize, SerializeSeq, SerializeStruct, SerializeStructVariant, SerializeTuple, SerializeTupleStruct,
    SerializeTupleVariant, Serializer,
};
use std::fmt;

/// What looks at the numbers.
pub(super) trait Visit {
    /// A number with a fraction.
    fn real(&mut self, x: Real);
    /// An integer, a truth value, a length, or which variant it is.
    fn whole(&mut self, n: u64);
    /// A text.
    fn text(&mut self, text: &str);
    /// What follows, up to [`Visit::leave`], is the content of this field or variant.
    fn enter(&mut self, _name: &'static str) {}
    /// See [`Visit::enter`].
    fn leave(&mut self) {}
    /// What follows is a list, a tuple of so many, or something that may be missing.
    fn shape(&mut self, _kind: &'static str, _length: usize) {}
}

/// Shows all of `value` to a visitor.
pub(super) fn walk(value: &impl Serialize, visit: &mut impl Visit) {
    // No state has anything that this serializer refuses: the walk is total.
    let walked = value.serialize(Walk(visit));
    debug_assert!(walked.is_ok(), "a state with something that cannot be walked");
}

struct Walk<'a, V>(&'a mut V);

impl<V> Walk<'_, V> {
    fn again(&mut self) -> Walk<'_, V> {
        Walk(self.0)
    }
}

impl<'a, V: Visit> Serializer for Walk<'a, V> {
    type Ok = ();
    type Error = fmt::Error;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = Impossible<(), fmt::Error>;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    #[inline]
    fn serialize_f64(self, x: f64) -> fmt::Result {
        self.0.real(x);
        Ok(())
    }

    fn serialize_f32(self, x: f32) -> fmt::Result {
        self.serialize_f64(x.into())
    }

    #[inline]
    fn serialize_u64(self, n: u64) -> fmt::Result {
        self.0.whole(n);
        Ok(())
    }

    fn serialize_bool(self, b: bool) -> fmt::Result {
        self.serialize_u64(b.into())
    }

    fn serialize_u8(self, n: u8) -> fmt::Result {
        self.serialize_u64(n.into())
    }

    fn serialize_u16(self, n: u16) -> fmt::Result {
        self.serialize_u64(n.into())
    }

    #[inline]
    fn serialize_u32(self, n: u32) -> fmt::Result {
        self.serialize_u64(n.into())
    }

    fn serialize_i8(self, n: i8) -> fmt::Result {
        self.serialize_i64(n.into())
    }

    fn serialize_i16(self, n: i16) -> fmt::Result {
        self.serialize_i64(n.into())
    }

    fn serialize_i32(self, n: i32) -> fmt::Result {
        self.serialize_i64(n.into())
    }

    fn serialize_i64(self, n: i64) -> fmt::Result {
        self.serialize_u64(n as u64)
    }

    fn serialize_char(self, c: char) -> fmt::Result {
        self.serialize_u64(u32::from(c).into())
    }

    fn serialize_str(self, text: &str) -> fmt::Result {
        self.0.text(text);
        Ok(())
    }

    fn serialize_bytes(self, bytes: &[u8]) -> fmt::Result {
        self.0.whole(bytes.len() as u64);
        bytes.iter().for_each(|&byte| self.0.whole(byte.into()));
        Ok(())
    }

    fn serialize_none(self) -> fmt::Result {
        self.0.shape("option", 1);
        self.serialize_u64(0)
    }

    fn serialize_some<T: ?Sized + Serialize>(self, value: &T) -> fmt::Result {
        self.0.shape("option", 1);
        self.0.whole(1);
        value.serialize(self)
    }

    fn serialize_unit(self) -> fmt::Result {
        Ok(())
    }

    fn serialize_unit_struct(self, _name: &'static str) -> fmt::Result {
        Ok(())
    }

    fn serialize_unit_variant(self, _name: &'static str, index: u32, variant: &'static str) -> fmt::Result {
        self.0.enter(variant);
        self.0.whole(index.into());
        self.0.leave();
        Ok(())
    }

    fn serialize_newtype_struct<T: ?Sized + Serialize>(self, _name: &'static str, value: &T) -> fmt::Result {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: ?Sized + Serialize>(
        mut self,
        _name: &'static str,
        index: u32,
        variant: &'static str,
        value: &T,
    ) -> fmt::Result {
        self.0.enter(variant);
        self.0.whole(index.into());
        value.serialize(self.again())?;
        self.0.leave();
        Ok(())
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<Self, fmt::Error> {
        self.0.shape("list", 0);
        // A sequence of unknown length could not be distinguished from a longer one.
        self.0.whole(length.ok_or(fmt::Error)? as u64);
        Ok(self)
    }

    fn serialize_tuple(self, length: usize) -> Result<Self, fmt::Error> {
        self.0.shape("tuple", length);
        Ok(self)
    }

    fn serialize_tuple_struct(self, _name: &'static str, _length: usize) -> Result<Self, fmt::Error> {
        Ok(self)
    }

    fn serialize_tuple_variant(self, _name: &'static str, index: u32, variant: &'static str, _length: usize) -> Result<Self, fmt::Error> {
        self.0.enter(variant);
        self.0.whole(index.into());
        Ok(self)
    }

    fn serialize_map(self, _length: Option<usize>) -> Result<Self::SerializeMap, fmt::Error> {
        Err(fmt::Error)
    }

    fn serialize_struct(self, _name: &'static str, _length: usize) -> Result<Self, fmt::Error> {
        Ok(self)
    }

    fn serialize_struct_variant(self, _name: &'static str, index: u32, variant: &'static str, _length: usize) -> Result<Self, fmt::Error> {
        self.0.enter(variant);
        self.0.whole(index.into());
        Ok(self)
    }
}

macro_rules! elements {
    ($trait:ident, $method:ident, $leaves:expr) => {
        impl<V: Visit> $trait for Walk<'_, V> {
            type Ok = ();
            type Error = fmt::Error;

            #[inline]
            fn $method<T: ?Sized + Serialize>(&mut self, value: &T) -> fmt::Result {
                value.serialize(self.again())
            }

            fn end(self) -> fmt::Result {
                if $leaves {
                    self.0.leave();
                }
                Ok(())
            }
        }
    };
}

elements!(SerializeSeq, serialize_element, false);
elements!(SerializeTuple, serialize_element, false);
elements!(SerializeTupleStruct, serialize_field, false);
elements!(SerializeTupleVariant, serialize_field, true);

macro_rules! fields {
    ($trait:ident, $leaves:expr) => {
        impl<V: Visit> $trait for Walk<'_, V> {
            type Ok = ();
            type Error = fmt::Error;

            fn serialize_field<T: ?Sized + Serialize>(&mut self, name: &'static str, value: &T) -> fmt::Result {
                self.0.enter(name);
                value.serialize(self.again())?;
                self.0.leave();
                Ok(())
            }

            fn end(self) -> fmt::Result {
                if $leaves {
                    self.0.leave();
                }
                Ok(())
            }
        }
    };
}

fields!(SerializeStruct, false);
fields!(SerializeStructVariant, true);
