// What of Apache ECharts the studio uses.
import * as echarts from "echarts/core";
import { HeatmapChart, LineChart, ParallelChart, ScatterChart } from "echarts/charts";
import {
    BrushComponent, GridComponent, MarkLineComponent, ParallelComponent, TitleComponent, TooltipComponent,
    VisualMapContinuousComponent,
} from "echarts/components";
import { CanvasRenderer } from "echarts/renderers";

echarts.use([
    HeatmapChart, LineChart, ParallelChart, ScatterChart, BrushComponent, GridComponent, MarkLineComponent,
    ParallelComponent, TitleComponent, TooltipComponent, VisualMapContinuousComponent, CanvasRenderer,
]);

export { echarts };
