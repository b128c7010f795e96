//! Products of matrices, for layers that see many samples at once.

/// A view of numbers as rows and columns.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    data: &'a [f32],
    size: (usize, usize),
    strides: (usize, usize),
}

impl<'a> Matrix<'a> {
    pub(crate) fn rows(data: &'a [f32], size: (usize, usize)) -> Self {
        assert!(data.len() >= size.0 * size.1, "a matrix of {size:?} needs more than {} numbers", data.len());
        Self { data, size, strides: (size.1, 1) }
    }

    pub(crate) fn transposed(self) -> Self {
        Self { size: (self.size.1, self.size.0), strides: (self.strides.1, self.strides.0), ..self }
    }
}

/// Adds the sum of each column; the matrix must not be a transposed one.
pub(crate) fn add_column_sums(matrix: Matrix<'_>, sums: &mut [f32]) {
    let (rows, columns) = matrix.size;
    assert!(matrix.strides == (columns, 1) && sums.len() == columns, "{:?} {}", matrix.size, sums.len());
    for row in matrix.data[..rows * columns].chunks_exact(columns) {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
}

/// Cuts off what is negative (ReLU).
pub(crate) fn rectify(values: &mut [f32]) {
    values.iter_mut().for_each(|value| *value = if *value > 0.0 { *value } else { 0.0 });
}

/// out = left * right, out row by row.
pub(crate) fn product(left: Matrix<'_>, right: Matrix<'_>, out: &mut [f32]) {
    multiply(left, right, 0.0, out);
}

/// out += left * right, out row by row.
pub(crate) fn add_product(left: Matrix<'_>, right: Matrix<'_>, out: &mut [f32]) {
    multiply(left, right, 1.0, out);
}

/// out = left * right + before * out.
#[allow(unsafe_code, reason = "matrixmultiply takes pointers; the sizes are checked here")]
fn multiply(left: Matrix<'_>, right: Matrix<'_>, before: f32, out: &mut [f32]) {
    let ((rows, inner), columns) = (left.size, right.size.1);
    assert!(inner == right.size.0 && out.len() >= rows * columns, "{:?} {:?}", left.size, right.size);
    let strides = |matrix: Matrix<'_>| (matrix.strides.0 as isize, matrix.strides.1 as isize);
    let ((row_left, column_left), (row_right, column_right)) = (strides(left), strides(right));
    // SAFETY: both views hold their size (checked when made), and out holds rows x columns.
    unsafe {
        matrixmultiply::sgemm(
            rows,
            inner,
            columns,
            1.0,
            left.data.as_ptr(),
            row_left,
            column_left,
            right.data.as_ptr(),
            row_right,
            column_right,
            before,
            out.as_mut_ptr(),
            columns as isize,
            1,
        );
    }
}
