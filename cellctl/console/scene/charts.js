// Changes points of a chart of NiceGUI: only these are sent, the chart keeps the others.
window.cellctlChangeChart = (id, changes) => {
  const chart = getElement(id)?.chart;
  if (!chart) return; // not drawn yet: it is drawn with all points
  const series = chart.getOption().series.map((one, index) => {
    const data = one.data.slice();
    for (const [place, point] of changes[index]) data[place] = point;
    return { data };
  });
  chart.setOption({ series });
};
