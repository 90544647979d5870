// A worker that puts Gaussians in order, the farthest first: two rounds of a counting sort over the bits of
// their float32 depths, which are in the order of the depths as long as those are positive.
"use strict";
let means, depths, words, first, second;

onmessage = ({ data }) => {
  if (data.means) {
    means = data.means;
    const count = means.length / 3;
    depths = new Float32Array(count);
    words = new Uint32Array(depths.buffer);
    first = new Uint32Array(count);
    second = new Uint32Array(count);
    return;
  }
  const [x, y, z] = data.ahead;
  const start = x * data.centre[0] + y * data.centre[1] + z * data.centre[2];
  let seen = 0;
  // Of those that are equally far the first is in front.
  for (let i = depths.length - 1; i >= 0; i--) {
    depths[i] = x * means[3 * i] + y * means[3 * i + 1] + z * means[3 * i + 2] - start;
    if (depths[i] > 0) first[seen++] = i;
  }
  counted(first, second, seen, 0);
  counted(second, first, seen, 16);
  const order = first.slice(0, seen);
  postMessage(order, [order.buffer]);
};

function counted(from, to, count, shift) {
  const places = new Uint32Array(65537);
  for (let i = 0; i < count; i++) places[65536 - ((words[from[i]] >>> shift) & 65535)]++;
  for (let i = 1; i < 65537; i++) places[i] += places[i - 1];
  for (let i = 0; i < count; i++) to[places[65535 - ((words[from[i]] >>> shift) & 65535)]++] = from[i];
}
