//! All conversions between NumPy and the engine.
//!
//! In: anything that `numpy.asarray(x, float64)` takes; the shape is checked, NaN and infinity are refused. Out: arrays that own their
//! data. Quaternions are (w, x, y, z) on the Python side.

use crate::errors::{OrRaise, to_py};
use nalgebra as na;
use numpy::ndarray as nd;
use numpy::{
    AllowTypeChange, Element, IntoPyArray, PyArray, PyArray1, PyArray2, PyArray3, PyArrayDescrMethods, PyArrayLikeDyn, PyArrayMethods,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyFloat, PyInt, PyList, PyTuple, PyType};
use quasirigid::Error;
use quasirigid::math::{Mat3, Pose, Real, Rot, Vec3};
use std::path::PathBuf;

/// An array-like as an array of real numbers, of whatever shape; `shape` is for the error.
pub fn real_array<'py>(value: &Bound<'py, PyAny>, what: &str, shape: &str) -> PyResult<PyArrayLikeDyn<'py, Real, AllowTypeChange>> {
    let py = value.py();
    let got = |value: &Bound<'_, PyAny>| value.get_type().name().map_or_else(|_| "something else".into(), |name| name.to_string());
    let refuse = |got: String| to_py(py, &Error::shape(what, format!("numbers of shape {shape}"), got, "give an array of real numbers"));
    if holds_masked(value, 0)? {
        let hint = "fill the masked entries, array.filled(0.0), or leave them out, array.compressed()";
        return Err(to_py(py, &Error::value(what, format!("numbers of shape {shape}, all of them known"), "a masked array", hint)));
    }
    // To real numbers NumPy would also make texts, dates and complex numbers, without a word.
    let plain = py.import("numpy")?.call_method1("asarray", (value,)).map_err(|_| refuse(got(value)))?;
    let plain = plain.cast::<PyUntypedArray>()?;
    match (plain.dtype().kind(), plain.ndim()) {
        (b'b' | b'i' | b'u' | b'f', _) | (b'O', 1..) => {}
        (_, 0) => return Err(refuse(got(value))),
        _ => return Err(refuse(format!("{} of {}", got(value), plain.dtype()))),
    }
    plain.extract().map_err(|_| refuse(got(value)))
}

/// NumPy's arrays have no more dimensions. Deeper lists, such as one that holds itself, are refused by NumPy.
const DEEPEST: usize = 64;

/// Whether an array-like is a masked array, or has one in its lists: NumPy would take the numbers under the masks without a word.
fn holds_masked(value: &Bound<'_, PyAny>, depth: usize) -> PyResult<bool> {
    static MASKED: PyOnceLock<Py<PyType>> = PyOnceLock::new();
    if value.is_exact_instance_of::<PyFloat>() || value.is_exact_instance_of::<PyInt>() || depth > DEEPEST {
        return Ok(false);
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        for item in value.try_iter()? {
            if holds_masked(&item?, depth + 1)? {
                return Ok(true);
            }
        }
        return Ok(false);
    }
    value.is_instance(MASKED.import(value.py(), "numpy.ma", "MaskedArray")?)
}

/// The numbers of an array-like in C order, and its shape.
fn numbers(value: &Bound<'_, PyAny>, what: &str, shape: &str) -> PyResult<(Vec<Real>, Vec<usize>)> {
    let py = value.py();
    let array = real_array(value, what, shape)?;
    let numbers: Vec<Real> = array.as_array().iter().copied().collect();
    quasirigid::error::check_finite(what, &numbers).or_raise(py)?;
    Ok((numbers, array.shape().to_vec()))
}

fn wrong_shape(py: Python<'_>, what: &str, expected: &str, got: &[usize]) -> PyErr {
    let list = got.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let got = if got.len() == 1 { format!("({list},)") } else { format!("({list})") };
    to_py(py, &Error::shape(what, format!("shape {expected}"), format!("shape {got}"), "reshape it"))
}

/// `(3,)`.
pub fn vec3(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec3> {
    let (x, shape) = numbers(value, what, "(3,)")?;
    if shape == [3] { Ok(Vec3::new(x[0], x[1], x[2])) } else { Err(wrong_shape(value.py(), what, "(3,)", &shape)) }
}

/// `(2,)`: of translation and of rotation.
pub fn pair(value: &Bound<'_, PyAny>, what: &str) -> PyResult<(Real, Real)> {
    let (x, shape) = numbers(value, what, "(2,)")?;
    if shape == [2] { Ok((x[0], x[1])) } else { Err(wrong_shape(value.py(), what, "(2,)", &shape)) }
}

/// `(3, 3)`.
pub fn mat3(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Mat3> {
    let (x, shape) = numbers(value, what, "(3, 3)")?;
    if shape == [3, 3] { Ok(Mat3::from_row_slice(&x)) } else { Err(wrong_shape(value.py(), what, "(3, 3)", &shape)) }
}

/// `(n, 3)`.
pub fn points(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<Vec3>> {
    let (x, shape) = numbers(value, what, "(n, 3)")?;
    if shape.len() == 2 && shape[1] == 3 {
        return Ok(x.chunks_exact(3).map(Vec3::from_column_slice).collect());
    }
    Err(wrong_shape(value.py(), what, "(n, 3)", &shape))
}

/// `(n,)`.
pub fn vector(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<Real>> {
    let (x, shape) = numbers(value, what, "(n,)")?;
    if shape.len() == 1 { Ok(x) } else { Err(wrong_shape(value.py(), what, "(n,)", &shape)) }
}

/// `(n, m)` for whatever n and m.
pub fn matrix(value: &Bound<'_, PyAny>, what: &str) -> PyResult<na::DMatrix<Real>> {
    let (x, shape) = numbers(value, what, "(n, m)")?;
    match shape[..] {
        [rows, columns] => Ok(na::DMatrix::from_row_slice(rows, columns, &x)),
        _ => Err(wrong_shape(value.py(), what, "(n, m)", &shape)),
    }
}

/// `(rows, columns)`, C order.
pub fn table(value: &Bound<'_, PyAny>, what: &str, rows: usize, columns: usize) -> PyResult<Vec<Real>> {
    let expected = format!("({rows}, {columns})");
    let (x, shape) = numbers(value, what, &expected)?;
    if shape == [rows, columns] { Ok(x) } else { Err(wrong_shape(value.py(), what, &expected, &shape)) }
}

/// `(4,)` as (w, x, y, z); need not have unit length, but must not be zero.
pub fn quaternion(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Rot> {
    let (x, shape) = numbers(value, what, "(4,)")?;
    if shape != [4] {
        return Err(wrong_shape(value.py(), what, "(4,)", &shape));
    }
    // By its largest number first, so that the length of a very long one is not infinite.
    let largest = x.iter().fold(0.0, |largest: Real, number| largest.max(number.abs()));
    let turn = (largest > 1e-6).then(|| Rot::from_quaternion(na::Quaternion::new(x[0], x[1], x[2], x[3]) / largest));
    turn.ok_or_else(|| {
        to_py(value.py(), &Error::value(what, "a quaternion (w, x, y, z) that is not zero", format!("{x:?}"), "(1, 0, 0, 0) does not turn"))
    })
}

/// A pose from a position and a quaternion, or, without a quaternion, with the rotation of `current`.
pub fn pose(position: &Bound<'_, PyAny>, turn: Option<&Bound<'_, PyAny>>, current: &Rot) -> PyResult<Pose> {
    let rotation = turn.map_or(Ok(*current), |q| quaternion(q, "quaternion"))?;
    Ok(Pose::from_parts(vec3(position, "position")?.into(), rotation))
}

/// A number from Python. One that is too large for a double is an error of its value, and what turns out to be no number, such as an array
/// of text, one of its type.
pub fn real(value: &Bound<'_, PyAny>) -> PyResult<Real> {
    let py = value.py();
    value.extract().map_err(|error: PyErr| {
        if error.is_instance_of::<PyOverflowError>(py) {
            return to_py(
                py,
                &Error::value("number", "one that a double holds, below 1.8e308", "one of very many digits", "check its unit"),
            );
        }
        if error.is_instance_of::<PyValueError>(py) {
            let name = value.get_type().name().map_or_else(|_| "something else".into(), |name| name.to_string());
            return PyTypeError::new_err(format!("must be real number, not {name}: {error}"));
        }
        error
    })
}

/// The same, or None.
pub fn optional_real(value: &Bound<'_, PyAny>) -> PyResult<Option<Real>> {
    if value.is_none() { Ok(None) } else { real(value).map(Some) }
}

/// The error for a text that is none: half of a pair of UTF-16, say, which Python has in its strings where file names were spoilt.
fn no_text(py: Python<'_>, error: PyErr) -> PyErr {
    if !error.is_instance_of::<PyValueError>(py) {
        return error;
    }
    to_py(py, &Error::value("text", "characters of Unicode", error, "leave out what is no character"))
}

/// A text from Python.
pub fn text<'a>(value: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    value.extract().map_err(|error: PyErr| no_text(value.py(), error))
}

/// The same, or None.
pub fn optional_text<'a>(value: &'a Bound<'_, PyAny>) -> PyResult<Option<&'a str>> {
    if value.is_none() { Ok(None) } else { text(value).map(Some) }
}

/// Texts from Python.
pub fn texts(value: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    value.extract().map_err(|error| no_text(value.py(), error))
}

/// A path from Python.
pub fn path(value: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    value.extract().map_err(|error| no_text(value.py(), error))
}

/// A whole number from Python, of whatever size: what is beyond 64 bits is kept as text, for the error that speaks of it.
pub struct Whole(std::result::Result<i64, String>);

impl From<i64> for Whole {
    fn from(value: i64) -> Self {
        Self(Ok(value))
    }
}

impl<'py> FromPyObject<'_, 'py> for Whole {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        match value.extract::<i64>() {
            Err(error) if error.is_instance_of::<PyOverflowError>(value.py()) => {
                let digits = value.str().map_or_else(|_| String::new(), |text| text.to_string());
                let short = (1..=40).contains(&digits.len());
                Ok(Self(Err(if short { digits } else { "a number of very many digits".into() })))
            }
            number => number.map(|number| Self(Ok(number))),
        }
    }
}

/// A count from Python, where a negative number is possible.
pub fn count(py: Python<'_>, what: &str, value: Whole) -> PyResult<usize> {
    count_from(py, what, value, 0)
}

/// A count from Python of at least `least`: what is less is refused by one message, be it 0 or negative.
pub fn count_from(py: Python<'_>, what: &str, value: Whole, least: usize) -> PyResult<usize> {
    let expected = format!("a whole number >= {least} that a machine can count to");
    let refuse = |got: String| to_py(py, &Error::value(what, expected, got, "give a count"));
    let counted = value.0.and_then(|number| usize::try_from(number).ok().filter(|&n| n >= least).ok_or_else(|| number.to_string()));
    counted.map_err(refuse)
}

/// A whole number from Python within `low` and `high`, where the type of the engine holds no others.
pub fn within(py: Python<'_>, what: &str, value: Whole, low: i64, high: i64) -> PyResult<i64> {
    let refuse = |got: String| {
        to_py(py, &Error::value(what, format!("a whole number from {low} to {high}"), got, "give a number within this range"))
    };
    value.0.and_then(|number| if (low..=high).contains(&number) { Ok(number) } else { Err(number.to_string()) }).map_err(refuse)
}

/// A port of the network, from `low` on: 0 where the system may choose.
pub fn port(py: Python<'_>, what: &str, value: Whole, low: u16) -> PyResult<u16> {
    within(py, what, value, i64::from(low), i64::from(u16::MAX)).map(|port| port as u16)
}

/// `(3,)`.
pub fn from_vec3<'py>(py: Python<'py>, v: &Vec3) -> Bound<'py, PyArray1<Real>> {
    PyArray1::from_slice(py, v.as_slice())
}

/// `(4,)` as (w, x, y, z).
pub fn from_rot<'py>(py: Python<'py>, q: &Rot) -> Bound<'py, PyArray1<Real>> {
    PyArray1::from_slice(py, &[q.w, q.i, q.j, q.k])
}

/// `(3, 3)`.
pub fn from_mat3<'py>(py: Python<'py>, m: &Mat3) -> PyResult<Bound<'py, PyArray2<Real>>> {
    rows(py, m.transpose().as_slice().to_vec(), 3)
}

/// `(n,)`.
pub fn from_vec<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    values.into_pyarray(py)
}

/// `(n, 3)`.
pub fn from_points<'py>(py: Python<'py>, points: impl IntoIterator<Item = Vec3>) -> PyResult<Bound<'py, PyArray2<Real>>> {
    rows(py, points.into_iter().flat_map(|p| [p.x, p.y, p.z]).collect(), 3)
}

/// Indices `(n,)` and points `(n, 3)`.
pub type Numbered<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray2<Real>>);

/// Points that are some of a list: their places in it, and where they are.
pub fn from_numbered(py: Python<'_>, (indices, points): (Vec<u32>, Vec<Vec3>)) -> PyResult<Numbered<'_>> {
    Ok((from_vec(py, indices), from_points(py, points)?))
}

/// `(n, columns)` from numbers in C order.
pub fn rows(py: Python<'_>, values: Vec<Real>, columns: usize) -> PyResult<Bound<'_, PyArray2<Real>>> {
    let n = values.len() / columns;
    values.into_pyarray(py).reshape([n, columns])
}

/// `(n, 3, 3)` from matrices.
pub fn from_matrices<'py>(py: Python<'py>, matrices: impl IntoIterator<Item = Mat3>) -> PyResult<Bound<'py, PyArray3<Real>>> {
    let values: Vec<Real> = matrices.into_iter().flat_map(|m| m.transpose().as_slice().to_vec()).collect();
    let n = values.len() / 9;
    values.into_pyarray(py).reshape([n, 3, 3])
}

/// A copy of the state of `property`, a name such as `Body.position`, that cannot be changed in place: what wrote into it would wait in
/// vain for the world to notice.
///
/// The classes, with the texts of their refusals, are in `quasirigid.arrays.read_only`.
pub fn state<'py, D>(property: &str, array: Bound<'py, PyArray<Real, D>>) -> PyResult<Bound<'py, PyAny>>
where
    D: nd::Dimension,
{
    static CLASSES: PyOnceLock<Py<PyDict>> = PyOnceLock::new();
    let py = array.py();
    let classes = CLASSES.get_or_try_init(py, || -> PyResult<Py<PyDict>> {
        Ok(py.import("quasirigid.arrays.read_only")?.getattr("CLASSES")?.cast_into::<PyDict>()?.unbind())
    })?;
    let class = classes.bind(py).get_item(property)?;
    array.readwrite().make_nonwriteable();
    array.call_method1(intern!(py, "view"), (class,))
}
