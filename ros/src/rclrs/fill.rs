//! Fills a ROS message, whose type is known at run time only, from CDR bytes. Arrays and sequences of numbers
//! are copied as a whole.

use super::read::{CdrReader, ReadError};
use ::rclrs::rosidl_runtime_rs::{Sequence, SequenceAlloc};
use ::rclrs::{
    ArrayValueMut, BoundedSequenceValueMut, DynamicBoundedSequenceMut, DynamicBoundedStringMut,
    DynamicMessageViewMut, DynamicSequenceElementMut, SequenceValueMut, SimpleValueMut, ValueMut,
};
use bytemuck::{AnyBitPattern, NoUninit};

/// Fills `message` with the fields of `cdr`.
pub fn fill(message: DynamicMessageViewMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    for (_, field) in message.iter_mut() {
        value(field, cdr)?;
    }
    Ok(())
}

/// Does the same for the messages of an array or a sequence.
fn fill_all(messages: &mut [DynamicMessageViewMut<'_>], cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    let Some(first) = messages.first() else { return Ok(()) };
    let fields: Vec<String> = first.structure().fields.iter().map(|field| field.name.clone()).collect();
    for message in messages {
        for field in &fields {
            value(message.get_mut(field).expect("a field of the same structure"), cdr)?;
        }
    }
    Ok(())
}

fn value(value: ValueMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    match value {
        ValueMut::Simple(value) => simple(value, cdr),
        ValueMut::Array(values) => array(values, cdr),
        ValueMut::Sequence(values) => sequence(values, cdr),
        ValueMut::BoundedSequence(values) => bounded(values, cdr),
    }
}

const NEVER: &str = "types with wide characters and long doubles are refused when a topic is announced";

fn simple(value: SimpleValueMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    use SimpleValueMut as V;
    match value {
        V::Float(v) => *v = cdr.number()?,
        V::Double(v) => *v = cdr.number()?,
        V::Char(v) | V::Octet(v) | V::Uint8(v) => *v = cdr.number()?,
        V::Boolean(v) => *v = cdr.bool()?,
        V::Int8(v) => *v = cdr.number()?,
        V::Uint16(v) => *v = cdr.number()?,
        V::Int16(v) => *v = cdr.number()?,
        V::Uint32(v) => *v = cdr.number()?,
        V::Int32(v) => *v = cdr.number()?,
        V::Uint64(v) => *v = cdr.number()?,
        V::Int64(v) => *v = cdr.number()?,
        V::String(v) => *v = cdr.string()?.into(),
        V::BoundedString(mut v) => bounded_string(&mut v, cdr)?,
        V::Message(v) => fill(v, cdr)?,
        V::LongDouble(_) | V::WChar(_) | V::WString(_) | V::BoundedWString(_) => unreachable!("{NEVER}"),
    }
    Ok(())
}

fn array(values: ArrayValueMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    use ArrayValueMut as V;
    match values {
        V::FloatArray(v) => cdr.numbers(v),
        V::DoubleArray(v) => cdr.numbers(v),
        V::CharArray(v) | V::OctetArray(v) | V::Uint8Array(v) => cdr.numbers(v),
        V::BooleanArray(v) => each(v, || cdr.bool()),
        V::Int8Array(v) => cdr.numbers(v),
        V::Uint16Array(v) => cdr.numbers(v),
        V::Int16Array(v) => cdr.numbers(v),
        V::Uint32Array(v) => cdr.numbers(v),
        V::Int32Array(v) => cdr.numbers(v),
        V::Uint64Array(v) => cdr.numbers(v),
        V::Int64Array(v) => cdr.numbers(v),
        V::StringArray(v) => each(v, || Ok(cdr.string()?.into())),
        V::BoundedStringArray(mut v) => v.iter_mut().try_for_each(|v| bounded_string(v, cdr)),
        V::MessageArray(mut v) => fill_all(&mut v, cdr),
        V::LongDoubleArray(..) | V::WCharArray(_) | V::WStringArray(_) | V::BoundedWStringArray(_) => {
            unreachable!("{NEVER}")
        }
    }
}

fn sequence(values: SequenceValueMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    use SequenceValueMut as V;
    match values {
        V::FloatSequence(v) => numbers(v, cdr),
        V::DoubleSequence(v) => numbers(v, cdr),
        V::CharSequence(v) | V::OctetSequence(v) | V::Uint8Sequence(v) => numbers(v, cdr),
        V::BooleanSequence(v) => {
            *v = Sequence::new(cdr.length(1)?);
            each(v, || cdr.bool())
        }
        V::Int8Sequence(v) => numbers(v, cdr),
        V::Uint16Sequence(v) => numbers(v, cdr),
        V::Int16Sequence(v) => numbers(v, cdr),
        V::Uint32Sequence(v) => numbers(v, cdr),
        V::Int32Sequence(v) => numbers(v, cdr),
        V::Uint64Sequence(v) => numbers(v, cdr),
        V::Int64Sequence(v) => numbers(v, cdr),
        V::StringSequence(v) => {
            *v = Sequence::new(cdr.length(LENGTH_BYTES)?);
            each(v, || Ok(cdr.string()?.into()))
        }
        V::BoundedStringSequence(mut v) => {
            v.reset(cdr.length(LENGTH_BYTES)?);
            v.iter_mut().try_for_each(|v| bounded_string(v, cdr))
        }
        V::MessageSequence(mut v) => {
            v.reset(cdr.length(1)?);
            fill_all(&mut v, cdr)
        }
        V::LongDoubleSequence(_)
        | V::WCharSequence(_)
        | V::WStringSequence(_)
        | V::BoundedWStringSequence(_) => unreachable!("{NEVER}"),
    }
}

fn bounded(values: BoundedSequenceValueMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    use BoundedSequenceValueMut as V;
    match values {
        V::FloatBoundedSequence(v) => bounded_numbers(v, cdr),
        V::DoubleBoundedSequence(v) => bounded_numbers(v, cdr),
        V::CharBoundedSequence(v) | V::OctetBoundedSequence(v) | V::Uint8BoundedSequence(v) => {
            bounded_numbers(v, cdr)
        }
        V::BooleanBoundedSequence(mut v) => {
            make_room(&mut v, 1, cdr)?;
            each(&mut v, || cdr.bool())
        }
        V::Int8BoundedSequence(v) => bounded_numbers(v, cdr),
        V::Uint16BoundedSequence(v) => bounded_numbers(v, cdr),
        V::Int16BoundedSequence(v) => bounded_numbers(v, cdr),
        V::Uint32BoundedSequence(v) => bounded_numbers(v, cdr),
        V::Int32BoundedSequence(v) => bounded_numbers(v, cdr),
        V::Uint64BoundedSequence(v) => bounded_numbers(v, cdr),
        V::Int64BoundedSequence(v) => bounded_numbers(v, cdr),
        V::StringBoundedSequence(mut v) => {
            make_room(&mut v, LENGTH_BYTES, cdr)?;
            each(&mut v, || Ok(cdr.string()?.into()))
        }
        V::BoundedStringBoundedSequence(mut v) => {
            make_room(&mut v, LENGTH_BYTES, cdr)?;
            v.iter_mut().try_for_each(|v| bounded_string(v, cdr))
        }
        V::MessageBoundedSequence(mut v) => {
            make_room(&mut v, 1, cdr)?;
            fill_all(&mut v, cdr)
        }
        V::LongDoubleBoundedSequence(..)
        | V::WCharBoundedSequence(_)
        | V::WStringBoundedSequence(_)
        | V::BoundedWStringBoundedSequence(_) => unreachable!("{NEVER}"),
    }
}

/// Bytes of a string's length, the least that it takes.
const LENGTH_BYTES: usize = 4;

fn each<T>(out: &mut [T], mut next: impl FnMut() -> Result<T, ReadError>) -> Result<(), ReadError> {
    out.iter_mut().try_for_each(|value| next().map(|read| *value = read))
}

fn numbers<T>(out: &mut Sequence<T>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError>
where
    T: SequenceAlloc + AnyBitPattern + NoUninit,
{
    let length = cdr.length(size_of::<T>())?;
    *out = Sequence::new(length);
    cdr.numbers(out)
}

fn bounded_numbers<'msg, T>(
    mut out: DynamicBoundedSequenceMut<'msg, T>,
    cdr: &mut CdrReader<'_>,
) -> Result<(), ReadError>
where
    T: DynamicSequenceElementMut<'msg> + AnyBitPattern + NoUninit,
{
    make_room(&mut out, size_of::<T>(), cdr)?;
    cdr.numbers(&mut out)
}

fn make_room<'msg, T: DynamicSequenceElementMut<'msg>>(
    out: &mut DynamicBoundedSequenceMut<'msg, T>,
    element_bytes: usize,
    cdr: &mut CdrReader<'_>,
) -> Result<(), ReadError> {
    let length = cdr.length(element_bytes)?;
    out.try_reset(length).map_err(|error| ReadError::Bound { expected: error.upper_bound, actual: error.len })
}

fn bounded_string(out: &mut DynamicBoundedStringMut<'_>, cdr: &mut CdrReader<'_>) -> Result<(), ReadError> {
    let (text, expected) = (cdr.string()?, out.upper_bound().get());
    out.try_assign(text).map_err(|_| ReadError::Bound { expected, actual: text.len() })
}
