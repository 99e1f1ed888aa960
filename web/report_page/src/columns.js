// Columns of numbers, as packed by delta3_pacdrive/studies/report_page/packed_columns.py.

const NOTHING = -(2 ** 31); // a cycle that the recording lacks

// Bytes of a base64 text.
function bytesOf(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i += 1) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Return the columns of a packed signal, each a Float64Array of so many rows; NaN where there is nothing.
export async function unpacked(packed, rows) {
  const bytes = await inflated(bytesOf(packed.data));
  const columns = [];
  for (let column = 0; column < packed.columns; column += 1) {
    const first = 4 * rows * column;
    const whole = new Int32Array(rows);
    for (let i = 0; i < rows; i += 1) {
      // bytes of equal weight stand together; zigzag made negative numbers odd
      const zigzag =
        bytes[first + i] |
        (bytes[first + rows + i] << 8) |
        (bytes[first + 2 * rows + i] << 16) |
        (bytes[first + 3 * rows + i] << 24);
      whole[i] = (zigzag >>> 1) ^ -(zigzag & 1);
    }
    // sums that wrap around undo differences that did
    for (let order = 0; order < packed.order; order += 1) {
      for (let i = 1; i < rows; i += 1) whole[i] = (whole[i] + whole[i - 1]) | 0;
    }
    columns.push(Float64Array.from(whole, (value) => (value === NOTHING ? NaN : value * packed.resolution)));
  }
  return columns;
}
