"""Look and behaviour of the page: the style sheet, and a cursor that shows the same instant in every chart."""

STYLE = """
:root{--ink:#1d252c;--soft:#5d6b76;--line:#dfe5ea;--grid:#eceff2;--paper:#fff;--outage:#e6ebf0;--accent:#0b5c8a}
*{box-sizing:border-box}
body{margin:0;background:#f3f5f7;color:var(--ink);font:14px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
main{max-width:1024px;margin:0 auto;padding:24px 32px 48px;background:var(--paper);box-shadow:0 0 12px #0001}
h1{font-size:26px;margin:0 0 10px;font-weight:650;letter-spacing:-.01em}
h2{font-size:17px;margin:34px 0 10px;padding-bottom:5px;border-bottom:2px solid var(--accent);font-weight:620}
header dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(280px,1fr));gap:4px 18px;margin:0}
header dl div{display:flex;gap:8px}
dt{color:var(--soft);min-width:88px}
dd{margin:0;font-variant-numeric:tabular-nums}
.note{color:var(--soft);margin:6px 0;font-size:13px}
.sentences{list-style:none;padding:0;margin:0}
.sentences li{border-left:5px solid;padding:5px 12px;margin:7px 0;background:#f8fafb;font-size:15px}
svg{display:inline-block;vertical-align:top;max-width:100%;height:auto;margin:2px 2px 6px 0}
svg text{font:11px system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif;fill:var(--ink)}
svg .title{font-weight:600;font-size:12px}
svg .tick,svg .legend,svg .refusal{fill:var(--soft);font-size:10.5px}
svg .lane{font-weight:600;font-size:12px}
svg .mode{fill:#fff;font-size:11px;font-weight:600}
svg .station-name{font-weight:600}
.grid{stroke:var(--grid)}
.zero{stroke:#aab4bc}
.frame{fill:none;stroke:#c3ccd3}
.outage{fill:var(--outage)}
.refused{stroke:#c0392b;stroke-width:1;fill:none}
.station{fill:#fff;stroke:#6a4c93;stroke-width:2}
.end{fill:#fff;stroke:#222;stroke-width:2}
.scale{fill:none;stroke:#333;stroke-width:1.5}
.north{fill:#333}
.cursor{stroke:#333;stroke-dasharray:3 3;pointer-events:none}
.wide{overflow-x:auto}
table{border-collapse:collapse;margin:10px 0 18px;font-size:12.5px;font-variant-numeric:tabular-nums;width:100%}
caption{text-align:left;font-weight:600;padding:4px 0}
th{font-weight:600;color:var(--soft);border-bottom:1.5px solid #c3ccd3;vertical-align:bottom}
th,td{padding:3px 9px 3px 0}
td{border-bottom:1px solid var(--line)}
.l{text-align:left;white-space:nowrap}
.r{text-align:right}
details{margin:10px 0}
summary{cursor:pointer;font-weight:600;color:var(--accent)}
pre{font-size:11.5px;background:#f8fafb;padding:12px;overflow:auto}
#when{position:fixed;right:14px;bottom:12px;background:#1d252ce6;color:#fff;padding:4px 11px;border-radius:4px;display:none;
font-variant-numeric:tabular-nums}
@media print{body{background:#fff}main{box-shadow:none;max-width:none}svg,tr{break-inside:avoid}}
""".strip()

SCRIPT = """
(function(){
var charts=[].slice.call(document.querySelectorAll('svg.chart')),box=document.getElementById('when');
function draw(t){charts.forEach(function(c){
 var d=c.dataset,x=+d.left+(t-d.start)/(d.end-d.start)*(d.right-d.left),l=c.querySelector('.cursor');
 if(!l){l=document.createElementNS('http://www.w3.org/2000/svg','line');l.setAttribute('class','cursor');
  l.setAttribute('y1',4);l.setAttribute('y2',c.viewBox.baseVal.height-20);c.appendChild(l);}
 l.setAttribute('x1',x);l.setAttribute('x2',x);l.style.display=t==null?'none':'';});}
charts.forEach(function(c){
 c.addEventListener('mousemove',function(e){
  var d=c.dataset,r=c.getBoundingClientRect(),x=(e.clientX-r.left)/r.width*c.viewBox.baseVal.width;
  var t=+d.start+(x-d.left)/(d.right-d.left)*(d.end-d.start);
  if(t<+d.start||t>+d.end){return;}
  draw(t);box.style.display='block';
  box.textContent='t = '+t.toFixed(2)+' s, '+(t-d.start).toFixed(1)+' s after the start';});
 c.addEventListener('mouseleave',function(){draw(null);box.style.display='none';});
});
})();
""".strip()
