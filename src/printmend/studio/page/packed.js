// A picture as scene.py packs it: its head, and tables of four 16-bit numbers a point, of the kinds that are asked for.
export function unpacked(buffer, kinds) {
  const size = new DataView(buffer).getUint32(0, true), head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size))), each = Math.ceil(head.points / head.row) * head.row * 4;
  return [head, ...kinds.map((Kind, i) => new Kind(buffer, 4 + size + i * each * Kind.BYTES_PER_ELEMENT, each))];
}
